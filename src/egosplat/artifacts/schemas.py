"""The schemas of artifacts, and what stages read from several of them.

A stage that imports one of these is stale when that one changes, not when another does (``pipeline.code_hash``): a definition
stands below those that it needs.
"""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Schema, table

# ``frames.zarr``: the frames of a recording, and how they lie.
FRAMES = table("""
    frames, version 1
    rgb                | uint8 frame height width 3, by row | sRGB | rectified pictures
    valid              | bool height width | - | pixels inside the lens circle
    masked             | bool frame height width, by row, optional | - | valid pixels that a frame's own mask
        or transparency leaves out
    timestamp_ns       | int64 frame | ns | capture time
    exposure_middle_ns | int64 frame | ns | middle of the exposure; poses belong to it
    train              | bool frame | - | frames to train on
    evaluation         | bool frame | - | frames to evaluate on
""")


def shown_pixels(frames: Artifact, index: int, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) bool: the pixels of a frame that show the scene; ``valid`` is the array of this name."""
    return valid & ~frames.row("masked", index) if frames.has("masked") else valid


def seconds_of(frames: Artifact) -> NDArray[np.float64]:
    """(F,) time of each frame since the first [s]."""
    times = frames.read("timestamp_ns")
    return (times - times[:1]) / 1e9


def lies_on_its_side(frames: Artifact) -> bool:
    """Whether images lie on their side, as from Aria's sensor (docs/method.md#upright)."""
    # OpenCLIP and the transient network need upright images: they are turned clockwise.
    return frames.facts["format"] == "adt" and not frames.facts["upright"]


# ``annotations.zarr``: instance maps of the evaluation frames. For evaluation only.
ANNOTATIONS = table("""
    annotations, version 1
    frame        | int64 evaluation, count | index | index of the evaluation frame in frames.zarr
    annotated    | bool evaluation | - | whether the frame has an annotation
    instance_map | int32 evaluation height width, -1 or index of instances, by row | index | index into the
        instances of the facts, -1 where nothing is annotated
    covered_map  | int32 evaluation layer height width, -1 or index of instances, by row, optional | index |
        the same for the instances that others cover in part, whole, in as many layers as they need
""")


# ``poses.zarr``: camera poses and points.
POSES = table("""
    poses, version 1
    camera_to_world | float64 frame 4 4, poses or nan | m | OpenCV axes; NaN where not registered
    registered      | bool frame | - | frames that have a pose
    intrinsics      | float64 3 3, pinhole | px | pinhole matrix, pixel centers at + 0.5
    up              | float64 3, unit vector | - | unit vector against gravity, in the world
    points/xyz      | float64 point 3 | m | points of the scene, in the world
    points/rgb      | uint8 point 3 | sRGB | their colors
""")


def length_unit(poses: Artifact) -> str:
    """The unit of lengths in the scene's world: ``m``, or ``scene units`` where COLMAP's scale is arbitrary."""
    return "scene units" if poses.facts.get("notes", {}).get("scale") == "arbitrary" else "m"


# ``transient.zarr``: the probability that a pixel is transient, and its mean over instances.
TRANSIENT = table("""
    transient, version 2
    probability       | float16 frame height width, share, by row | 0..1 | the network's probability that the
        pixel is of something transient, of frames without a pose too
    stands_out        | bool frame height width, by row | - | pixels whose squared difference to the temporary
        Gaussians after the warm-up exceeds 3.5 medians of their frame; false in frames without residual_scale
    compared          | bool height width | - | pixels that stands_out speaks of: inside the lens circle
    residual_scale    | float32 frame, scale or nan | squared sRGB in 0..1 | median squared difference of the
        frame to the temporary Gaussians after the warm-up; NaN if it was not measured: not trained on, or
        penalty_unit is absolute
    weights           | float32 number | - | the network's tensors, flat, one after the other; facts name them
    curve/iteration   | int64 record, count | iteration | last iteration of each record
    curve/loss        | float64 record, any | - | mean loss of the iterations since the record before
    curve/probability | float64 record, share or nan | 0..1 | mean probability in the same iterations; 0 in
        the warm-up
""")


# The arrays that instances.zarr has, too.
LABELED = """
    labels          | int32 frame level height width, -1 or index of instance, by row | index | instance that the
        pixel belongs to at the level, -1 for none; levels as the facts name them
    instances/level | int8 instance, index of level | index | level of the instance; it is seen at no other"""

# ``segments.zarr``: instances at up to three levels, tracked through the video.
SEGMENTS = table(f"""
    segments, version 2{LABELED}
    instances/predicted_iou | float32 instance | 0..1 | IoU that SAM2 predicts for the mask that began it; 1
        without SAM2
    instances/stability     | float32 instance, share | 0..1 | IoU of that mask cut a little higher and lower;
        1 without SAM2
    instances/first_frame   | int64 instance, count | index | frame whose prompts began it
    instances/moving        | bool instance | - | tracked, because the transient network says that it moves
""")


# Value of the fact ``source``: the tracks of segments.zarr, unchanged.
TRACKS = "tracks"

# ``instances.zarr``: things that hold in 3D, or the tracks of segments.zarr unchanged.
INSTANCES = table(f"""
    instances, version 1{LABELED}
    instances/parent   | int32 instance, -1 or index of instance | index | instance of the next coarser level
        that holds most of it in 3D, -1 for none
    instances/masks    | int32 instance, count | count | masks of segments.zarr that are merged in it; of what
        moves, the frames that show it; else 1 for a track
    instances/moving   | bool instance | - | a track of segments.zarr of something that moves,
        not merged in 3D
    gaussians/xyz      | float32 gaussian 3 | m | centers of the Gaussians that masks are merged on
    gaussians/instance | int32 gaussian level, -1 or index of instance | index | instance that the Gaussian
        belongs to at the level, -1 for none
""")


def is_track(instances: Artifact) -> NDArray[np.bool_]:
    """(N,) the instances that are tracks; the others are masks that are merged in 3D."""
    moving = instances.read("instances/moving")
    return np.ones_like(moving) if instances.facts["source"] == TRACKS else moving


# ``view_features.zarr``: the feature of each instance in each frame that shows it.
VIEW_FEATURES = table("""
    view_features, version 1
    instance        | int32 view, index of instance | index | instance in segments.zarr; rows go by instance,
        then frame
    frame           | int32 view, count | index | frame in frames.zarr; training frames alone
    feature         | float32 view channel, any, by 2048 rows | - | OpenCLIP's of the crop, of unit norm
    area            | int32 view, count | px | pixels of the instance's mask in the frame
    box             | int32 view 4 | px | x0, y0, x1, y1 around the mask, the ends exclusive
    instances/level | int8 instance, index of levels | index | level of each instance, views or none
""")


# ``features.zarr``: aggregated features of instances, supervision of views, codes, decoder.
FEATURES = table("""
    features, version 1
    consistent      | float32 instance channel | - | aggregated over the inlier views; 0 where there is no
        view
    views           | int32 instance, count | count | views that were aggregated, outliers among them
    instances/level | int8 instance, index of levels | index | level of each instance
    instance        | int32 view, index of instance | index | instance; the rows of view_features.zarr
    frame           | int32 view, count | index | frame in frames.zarr
    inlier          | bool view | - | views that agree with their instance's median
    supervision     | float32 view channel, by 2048 rows | - | what the instance means in the frame
    code            | float32 view code, by 65536 rows | - | supervision, compressed
    consistent_code | float32 instance code | - | consistent, compressed
    decoder/values  | float32 number | - | of each layer its (out, in) weights and (out,) biases; the facts
        name the widths
""")


# Why nothing is masked, in the fact ``withheld``.
BY_NETWORK, BY_INSTANCES = "probability", "instances"

# ``masks.zarr``: the transient instances, and the pixels that training masks.
MASKS = table("""
    masks, version 2
    refined              | bool frame height width, by row | - | pixels of a transient instance, of any level
        that is asked for, where the network calls them transient, and of regions that the network is sure of
        for several frames
    instances/score      | float32 instance, share | 0..1 | mean probability over all pixels of the instance
        in the training frames; 0 without any pixel
    instances/stands_out | float32 instance, share | 0..1 | share of the instance's pixels that stand out
        (transient.zarr), in training frames where this was measured
    instances/transient  | bool instance | - | transient by score and by what stands out, at a level that is
        asked for
""")


# Values of ``corrections/source``.
AS_GIVEN, TRAINED, FITTED, INTERPOLATED = range(4)

# ``splats.zarr``: trained Gaussians, training curves, and renders of held-out frames.
SPLATS = table("""
    splats, version 2
    means                       | float32 gaussian 3 | m | centers, in the world of poses.zarr
    quats                       | float32 gaussian 4 | - | rotations to the world, wxyz, of any length but 0
    log_scales                  | float32 gaussian 3 | log m | natural logarithm of the standard deviations
    logit_opacities             | float32 gaussian | logit | opacity = 1 / (1 + exp(-logit))
    sh                          | float32 gaussian coefficient 3 | sRGB 0..1 | spherical harmonics of the
        direction from camera to center, 3DGS's order; color = max(sum + 0.5, 0)
    features                    | float32 gaussian channel | - | codes of all levels, side by side, where they
        were trained with the geometry; else no column
    curve/iteration             | int64 record, count | iteration | last iteration of each record
    curve/loss                  | float64 record, any | - | mean loss of the iterations since the record
        before
    curve/gaussians             | int64 record, count | count | Gaussians after that iteration
    history/iteration           | int64 evaluation, count | iteration | when Gaussians were evaluated
    history/psnr                | float64 evaluation, any | dB | mean over the held-out frames; NaN without
        any
    history/ssim                | float64 evaluation, finite or nan | - | mean over the held-out frames; NaN
        without any
    held_out/frame              | int64 frame, count | index | held-out frame's index in frames.zarr
    held_out/psnr               | float64 frame, any | dB | of the Gaussians stored here, valid pixels only
    held_out/ssim               | float64 frame, finite or nan | - | the same; NaN where no whole window is
        valid
    held_out/render             | uint8 frame height width 3, by row | sRGB | the held-out frames, rendered
    held_out/psnr_given         | float64 frame, any, optional | dB | with the poses of poses.zarr and no gain
    held_out/ssim_given         | float64 frame, finite or nan, optional | - | the same
    held_out/render_given       | uint8 frame height width 3, by row, optional | sRGB | the same
    corrections/camera_to_world | float64 recorded_frame 4 4, poses or nan, optional | m | poses of all frames
        after correction, OpenCV axes; NaN where not registered
    corrections/source          | int8 recorded_frame, from 0 to 3, optional | - | 0 as in poses.zarr, 1
        trained, 2 held out and fitted afterwards, 3 between frames that were trained
    corrections/shift           | float64 recorded_frame 3, finite or nan, optional | m | from the camera's
        center in poses.zarr to that after correction, in the world
    corrections/turn            | float64 recorded_frame, scale or nan, optional | deg | angle between the
        orientations before and after
    corrections/gain            | float64 recorded_frame 3, scale or nan, optional | - | factor of red, green
        and blue from the Gaussians' render to the frame
""")


def camera_poses(poses: Artifact, splats: Artifact) -> NDArray[np.float64]:
    """(F, 4, 4) float64 poses to render with, those of training where it refined them; NaN where not registered."""
    corrected = splats.has("corrections/camera_to_world")
    return splats.read("corrections/camera_to_world") if corrected else poses.read("camera_to_world")


# ``tiles.zarr``: OpenCLIP features of the tiles of each training frame, at scales of which the first has the smallest tiles.
TILE_SCALES = [f"scale/{number}" for number in range(7)]
_SCALE_ROWS = "".join(
    f"\n    {name} | float16 view row_{number} column_{number} channel, by row | - | OpenCLIP feature of each tile, "
    "of unit norm; 0 without one; the facts have side and stride"
    for number, name in enumerate(TILE_SCALES)
)
TILES = table(f"""
    tiles, version 1
    frame       | int32 view, count | index | training frame in frames.zarr{_SCALE_ROWS}
    regulariser | float16 view row column component, by row, optional | - | principal components of the frame's
        SAM2 map, each channel of variance 1; none if tiles.regulariser is none
""")


# ``language.zarr``: a code for each Gaussian of ``splats.zarr`` and each level.
LANGUAGE = table("""
    language, version 1
    code            | float32 gaussian level channel | - | code, for the artifact's own decoder or that of
        features.zarr; 0 where the share is 0; levels as the facts name them
    share           | float32 gaussian level, share | 0..1 | share of what the Gaussian shows in the training
        views at which the level has an instance with a code
    decoder/values  | float32 number, optional | - | as in features.zarr, of a decoder that the method learns
    curve/iteration | int64 record, count | iteration | last iteration of each record of training
    curve/loss      | float64 record, any | - | mean loss of the iterations since the record before; none if
        not trained
""")


# ``histories.zarr``: things that leave a place and are put down at another (``carries``), Gaussians of those that lie somewhere
# for a while (``rests``), and which of both are of one thing.
HISTORIES = table("""
    histories, version 1
    carries/instance          | int32 carry, count | index | track in instances.zarr that shows most of it
    carries/first_frame       | int64 carry, count | index | frame in which it leaves its place
    carries/last_frame        | int64 carry, count | index | frame from which it lies still again, or the last
        that shows it
    carries/start             | float64 carry 3, finite or nan | m | where it lay before, in the world; NaN if
        not known
    carries/end               | float64 carry 3, finite or nan | m | where it is put down; NaN if not known
    carries/size              | float64 carry | m | side of a square as large as its masks, their median
    carries/best_frame        | int64 carry, count | index | frame that shows most of it
    carries/box               | int32 carry 4 | px | x0, y0, x1, y1 around it there, the ends exclusive
    carries/feature           | float32 carry channel, any | - | mean of OpenCLIP's features of its views and
        of those of carries that look alike, of unit norm; zeros without views
    carries/thing             | int32 carry, -1 or index of thing | index | the thing that each carry moves,
        -1 for none that rests
    carries/from_rest         | int32 carry, -1 or index of rest | index | rest before each carry, -1 for none
    carries/to_rest           | int32 carry, -1 or index of rest | index | rest after each carry, -1 for none
    rests/thing               | int32 rest, index of thing | index | the thing that rests
    rests/from_frame          | int64 rest, count | index | first frame that shows it there
    rests/until_frame         | int64 rest, count | index | last frame that shows it there
    rests/absent_before       | int64 rest, count or -1 | index | last frame before that shows the place without
        it, -1 for none
    rests/absent_after        | int64 rest, count or -1 | index | first frame after that shows the place without
        it, -1 for none
    rests/center              | float64 rest 3 | m | middle of its Gaussians, in the world
    rests/size                | float64 rest | m | as that of its carries, their median
    rests/gain                | float32 rest, share | 0..1 | share of the error of the pixels that its
        Gaussians change, in these frames, which they explain
    rests/best_frame          | int64 rest, count | index | frame that shows most of it
    rests/box                 | int32 rest 4 | px | x0, y0, x1, y1 around it there, the ends exclusive
    things/feature            | float32 thing channel, any | - | mean of OpenCLIP's features of a thing's
        rests and carries, of unit norm; zeros without views
    gaussians/rest            | int32 gaussian, index of rest | index | rest
    gaussians/means           | float32 gaussian 3 | m | as in splats.zarr
    gaussians/quats           | float32 gaussian 4 | - | as in splats.zarr
    gaussians/log_scales      | float32 gaussian 3 | log m | as in splats.zarr
    gaussians/logit_opacities | float32 gaussian | logit | as in splats.zarr
    gaussians/sh              | float32 gaussian coefficient 3 | sRGB 0..1 | as in splats.zarr
""")

# Every kind of artifact, by name.
_ALL = (FRAMES, ANNOTATIONS, POSES, TRANSIENT, SEGMENTS, INSTANCES, VIEW_FEATURES, FEATURES, MASKS)
SCHEMAS: dict[str, Schema] = {schema.name: schema for schema in (*_ALL, SPLATS, TILES, LANGUAGE, HISTORIES)}
