"""The schemas of artifacts, and what stages read from several of them.

A stage that imports one of these is stale when that one changes, not when another does (``pipeline.code_hash``): a definition
stands below those that it needs.
"""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import (
    ANY,
    COUNT,
    FINITE,
    FINITE_OR_UNKNOWN,
    PINHOLE,
    POSES_OR_UNKNOWN,
    SCALE_OR_UNKNOWN,
    SHARE,
    SHARE_OR_UNKNOWN,
    UNIT_VECTOR,
    Field,
    Schema,
    Values,
    index_of,
    index_or_none,
)
from egosplat.artifacts.tiles import TILES

# ``frames.zarr``: the frames of a recording, and how they lie.
FRAMES = Schema(
    "frames",
    1,
    {
        "rgb": Field("uint8 frame height width 3", "sRGB", "rectified pictures", by_row=True),
        "valid": Field("bool height width", "-", "pixels inside the lens circle"),
        "masked": Field(
            "bool frame height width",
            "-",
            "valid pixels that a frame's own mask or transparency leaves out",
            by_row=True,
            optional=True,
        ),
        "timestamp_ns": Field("int64 frame", "ns", "capture time"),
        "exposure_middle_ns": Field("int64 frame", "ns", "middle of the exposure; poses belong to it"),
        "train": Field("bool frame", "-", "frames to train on"),
        "evaluation": Field("bool frame", "-", "frames to evaluate on"),
    },
)


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
ANNOTATIONS = Schema(
    "annotations",
    1,
    {
        "frame": Field("int64 evaluation", "index", "index of the evaluation frame in frames.zarr", COUNT),
        "annotated": Field("bool evaluation", "-", "whether the frame has an annotation"),
        "instance_map": Field(
            "int32 evaluation height width",
            "index",
            "index into the instances of the facts, -1 where nothing is annotated",
            index_or_none("instances"),
            by_row=True,
        ),
        "covered_map": Field(
            "int32 evaluation layer height width",
            "index",
            "the same for the instances that others cover in part, whole, in as many layers as they need",
            index_or_none("instances"),
            by_row=True,
            optional=True,
        ),
    },
)


# ``poses.zarr``: camera poses and points.
POSES = Schema(
    "poses",
    1,
    {
        "camera_to_world": Field(
            "float64 frame 4 4", "m", "OpenCV axes; NaN where not registered", POSES_OR_UNKNOWN
        ),
        "registered": Field("bool frame", "-", "frames that have a pose"),
        "intrinsics": Field("float64 3 3", "px", "pinhole matrix, pixel centers at + 0.5", PINHOLE),
        "up": Field("float64 3", "-", "unit vector against gravity, in the world", UNIT_VECTOR),
        "points/xyz": Field("float64 point 3", "m", "points of the scene, in the world"),
        "points/rgb": Field("uint8 point 3", "sRGB", "their colors"),
    },
)


def length_unit(poses: Artifact) -> str:
    """The unit of lengths in the scene's world: ``m``, or ``scene units`` where COLMAP's scale is arbitrary."""
    return "scene units" if poses.facts.get("notes", {}).get("scale") == "arbitrary" else "m"


# ``transient.zarr``: the probability that a pixel is transient, and its mean over instances.
TRANSIENT = Schema(
    "transient",
    2,
    {
        "probability": Field(
            "float16 frame height width",
            "0..1",
            "the network's probability that the pixel is of something transient, of frames without a pose too",
            SHARE,
            by_row=True,
        ),
        "stands_out": Field(
            "bool frame height width",
            "-",
            "pixels whose squared difference to the temporary Gaussians after the warm-up exceeds 3.5 medians of their frame; "
            "false in frames without residual_scale",
            by_row=True,
        ),
        "compared": Field(
            "bool height width", "-", "pixels that stands_out speaks of: inside the lens circle"
        ),
        "residual_scale": Field(
            "float32 frame",
            "squared sRGB in 0..1",
            "median squared difference of the frame to the temporary Gaussians after the warm-up; NaN if it was not measured: "
            "not trained on, or penalty_unit is absolute",
            SCALE_OR_UNKNOWN,
        ),
        "weights": Field(
            "float32 number", "-", "the network's tensors, flat, one after the other; facts name them"
        ),
        "curve/iteration": Field("int64 record", "iteration", "last iteration of each record", COUNT),
        "curve/loss": Field(
            "float64 record", "-", "mean loss of the iterations since the record before", ANY
        ),
        "curve/probability": Field(
            "float64 record",
            "0..1",
            "mean probability in the same iterations; 0 in the warm-up",
            SHARE_OR_UNKNOWN,
        ),
    },
)


# The arrays that instances.zarr has, too.
LABELED = {
    "labels": Field(
        "int32 frame level height width",
        "index",
        "instance that the pixel belongs to at the level, -1 for none; levels as the facts name them",
        index_or_none("instance"),
        by_row=True,
    ),
    "instances/level": Field(
        "int8 instance", "index", "level of the instance; it is seen at no other", index_of("level")
    ),
}

# ``segments.zarr``: instances at up to three levels, tracked through the video.
SEGMENTS = Schema(
    "segments",
    2,
    {
        **LABELED,
        "instances/predicted_iou": Field(
            "float32 instance",
            "0..1",
            "IoU that SAM2 predicts for the mask that began it; 1 without SAM2",
            FINITE,
        ),
        "instances/stability": Field(
            "float32 instance",
            "0..1",
            "IoU of that mask cut a little higher and lower; 1 without SAM2",
            SHARE,
        ),
        "instances/first_frame": Field("int64 instance", "index", "frame whose prompts began it", COUNT),
        "instances/moving": Field(
            "bool instance", "-", "tracked, because the transient network says that it moves"
        ),
    },
)


# Value of the fact ``source``: the tracks of segments.zarr, unchanged.
TRACKS = "tracks"

# ``instances.zarr``: things that hold in 3D, or the tracks of segments.zarr unchanged.
INSTANCES = Schema(
    "instances",
    1,
    {
        **LABELED,
        "instances/parent": Field(
            "int32 instance",
            "index",
            "instance of the next coarser level that holds most of it in 3D, -1 for none",
            index_or_none("instance"),
        ),
        "instances/masks": Field(
            "int32 instance",
            "count",
            "masks of segments.zarr that are merged in it; of what moves, the frames that show it; else 1 for a track",
            COUNT,
        ),
        "instances/moving": Field(
            "bool instance", "-", "a track of segments.zarr of something that moves, not merged in 3D"
        ),
        "gaussians/xyz": Field(
            "float32 gaussian 3", "m", "centers of the Gaussians that masks are merged on"
        ),
        "gaussians/instance": Field(
            "int32 gaussian level",
            "index",
            "instance that the Gaussian belongs to at the level, -1 for none",
            index_or_none("instance"),
        ),
    },
)


def is_track(instances: Artifact) -> NDArray[np.bool_]:
    """(N,) the instances that are tracks; the others are masks that are merged in 3D."""
    moving = instances.read("instances/moving")
    return np.ones_like(moving) if instances.facts["source"] == TRACKS else moving


# ``view_features.zarr``: the feature of each instance in each frame that shows it.
VIEW_FEATURES = Schema(
    "view_features",
    1,
    {
        "instance": Field(
            "int32 view",
            "index",
            "instance in segments.zarr; rows go by instance, then frame",
            index_of("instance"),
        ),
        "frame": Field("int32 view", "index", "frame in frames.zarr; training frames alone", COUNT),
        "feature": Field(
            "float32 view channel", "-", "OpenCLIP's of the crop, of unit norm", ANY, by_row=2048
        ),
        "area": Field("int32 view", "px", "pixels of the instance's mask in the frame", COUNT),
        "box": Field("int32 view 4", "px", "x0, y0, x1, y1 around the mask, the ends exclusive"),
        "instances/level": Field(
            "int8 instance", "index", "level of each instance, views or none", index_of("levels")
        ),
    },
)


# ``features.zarr``: aggregated features of instances, supervision of views, codes, decoder.
FEATURES = Schema(
    "features",
    1,
    {
        "consistent": Field(
            "float32 instance channel", "-", "aggregated over the inlier views; 0 where there is no view"
        ),
        "views": Field("int32 instance", "count", "views that were aggregated, outliers among them", COUNT),
        "instances/level": Field("int8 instance", "index", "level of each instance", index_of("levels")),
        "instance": Field(
            "int32 view", "index", "instance; the rows of view_features.zarr", index_of("instance")
        ),
        "frame": Field("int32 view", "index", "frame in frames.zarr", COUNT),
        "inlier": Field("bool view", "-", "views that agree with their instance's median"),
        "supervision": Field(
            "float32 view channel", "-", "what the instance means in the frame", by_row=2048
        ),
        "code": Field("float32 view code", "-", "supervision, compressed", by_row=65536),
        "consistent_code": Field("float32 instance code", "-", "consistent, compressed"),
        "decoder/values": Field(
            "float32 number",
            "-",
            "of each layer its (out, in) weights and (out,) biases; the facts name the widths",
        ),
    },
)


# Why nothing is masked, in the fact ``withheld``.
BY_NETWORK, BY_INSTANCES = "probability", "instances"

# ``masks.zarr``: the transient instances, and the pixels that training masks.
MASKS = Schema(
    "masks",
    2,
    {
        "refined": Field(
            "bool frame height width",
            "-",
            "pixels of a transient instance, of any level that is asked for, where the network calls them transient, "
            "and of regions that the network is sure of for several frames",
            by_row=True,
        ),
        "instances/score": Field(
            "float32 instance",
            "0..1",
            "mean probability over all pixels of the instance in the training frames; 0 without any pixel",
            SHARE,
        ),
        "instances/stands_out": Field(
            "float32 instance",
            "0..1",
            "share of the instance's pixels that stand out (transient.zarr), in training frames where this was measured",
            SHARE,
        ),
        "instances/transient": Field(
            "bool instance", "-", "transient by score and by what stands out, at a level that is asked for"
        ),
    },
)


# Values of ``corrections/source``.
AS_GIVEN, TRAINED, FITTED, INTERPOLATED = range(4)

# ``splats.zarr``: trained Gaussians, training curves, and renders of held-out frames.
SPLATS = Schema(
    "splats",
    2,
    {
        "means": Field("float32 gaussian 3", "m", "centers, in the world of poses.zarr"),
        "quats": Field("float32 gaussian 4", "-", "rotations to the world, wxyz, of any length but 0"),
        "log_scales": Field("float32 gaussian 3", "log m", "natural logarithm of the standard deviations"),
        "logit_opacities": Field("float32 gaussian", "logit", "opacity = 1 / (1 + exp(-logit))"),
        "sh": Field(
            "float32 gaussian coefficient 3",
            "sRGB 0..1",
            "spherical harmonics of the direction from camera to center, 3DGS's order; color = max(sum + 0.5, 0)",
        ),
        "features": Field(
            "float32 gaussian channel",
            "-",
            "codes of all levels, side by side, where they were trained with the geometry; else no column",
        ),
        "curve/iteration": Field("int64 record", "iteration", "last iteration of each record", COUNT),
        "curve/loss": Field(
            "float64 record", "-", "mean loss of the iterations since the record before", ANY
        ),
        "curve/gaussians": Field("int64 record", "count", "Gaussians after that iteration", COUNT),
        "history/iteration": Field("int64 evaluation", "iteration", "when Gaussians were evaluated", COUNT),
        "history/psnr": Field(
            "float64 evaluation", "dB", "mean over the held-out frames; NaN without any", ANY
        ),
        "history/ssim": Field(
            "float64 evaluation", "-", "mean over the held-out frames; NaN without any", FINITE_OR_UNKNOWN
        ),
        "held_out/frame": Field("int64 frame", "index", "held-out frame's index in frames.zarr", COUNT),
        "held_out/psnr": Field("float64 frame", "dB", "of the Gaussians stored here, valid pixels only", ANY),
        "held_out/ssim": Field(
            "float64 frame", "-", "the same; NaN where no whole window is valid", FINITE_OR_UNKNOWN
        ),
        "held_out/render": Field(
            "uint8 frame height width 3", "sRGB", "the held-out frames, rendered", by_row=True
        ),
        # Only where poses or exposures are corrected. The scores and renders above are those after correction.
        "held_out/psnr_given": Field(
            "float64 frame", "dB", "with the poses of poses.zarr and no gain", ANY, optional=True
        ),
        "held_out/ssim_given": Field("float64 frame", "-", "the same", FINITE_OR_UNKNOWN, optional=True),
        "held_out/render_given": Field(
            "uint8 frame height width 3", "sRGB", "the same", by_row=True, optional=True
        ),
        "corrections/camera_to_world": Field(
            "float64 recorded_frame 4 4",
            "m",
            "poses of all frames after correction, OpenCV axes; NaN where not registered",
            POSES_OR_UNKNOWN,
            optional=True,
        ),
        "corrections/source": Field(
            "int8 recorded_frame",
            "-",
            "0 as in poses.zarr, 1 trained, 2 held out and fitted afterwards, 3 between frames that were trained",
            Values(least=AS_GIVEN, most=INTERPOLATED),
            optional=True,
        ),
        "corrections/shift": Field(
            "float64 recorded_frame 3",
            "m",
            "from the camera's center in poses.zarr to that after correction, in the world",
            FINITE_OR_UNKNOWN,
            optional=True,
        ),
        "corrections/turn": Field(
            "float64 recorded_frame",
            "deg",
            "angle between the orientations before and after",
            SCALE_OR_UNKNOWN,
            optional=True,
        ),
        "corrections/gain": Field(
            "float64 recorded_frame 3",
            "-",
            "factor of red, green and blue from the Gaussians' render to the frame",
            SCALE_OR_UNKNOWN,
            optional=True,
        ),
    },
)


def camera_poses(poses: Artifact, splats: Artifact) -> NDArray[np.float64]:
    """(F, 4, 4) float64 poses to render with, those of training where it refined them; NaN where not registered."""
    corrected = splats.has("corrections/camera_to_world")
    return splats.read("corrections/camera_to_world") if corrected else poses.read("camera_to_world")


# The fact ``decoded``: queries decode the code of each Gaussian and render relevancies, or they render codes and decode
# pixels. Trained codes are right where they are rendered; the code of a single one of these Gaussians means nothing.
GAUSSIANS, PIXELS = "gaussians", "pixels"

# ``language.zarr``: a code for each Gaussian of ``splats.zarr`` and each level.
LANGUAGE = Schema(
    "language",
    1,
    {
        "code": Field(
            "float32 gaussian level channel",
            "-",
            "code, for the artifact's own decoder or that of features.zarr; 0 where the share is 0; levels as the facts name them",
        ),
        "share": Field(
            "float32 gaussian level",
            "0..1",
            "share of what the Gaussian shows in the training views at which the level has an instance with a code",
            SHARE,
        ),
        "decoder/values": Field(
            "float32 number", "-", "as in features.zarr, of a decoder that the method learns", optional=True
        ),
        "curve/iteration": Field(
            "int64 record", "iteration", "last iteration of each record of training", COUNT
        ),
        "curve/loss": Field(
            "float64 record",
            "-",
            "mean loss of the iterations since the record before; none if not trained",
            ANY,
        ),
    },
)


# ``histories.zarr``: things that leave a place and are put down at another (``carries``), Gaussians of those that lie somewhere
# for a while (``rests``), and which of both are of one thing.
HISTORIES = Schema(
    "histories",
    1,
    {
        "carries/instance": Field(
            "int32 carry", "index", "track in instances.zarr that shows most of it", COUNT
        ),
        "carries/first_frame": Field("int64 carry", "index", "frame in which it leaves its place", COUNT),
        "carries/last_frame": Field(
            "int64 carry", "index", "frame from which it lies still again, or the last that shows it", COUNT
        ),
        "carries/start": Field(
            "float64 carry 3", "m", "where it lay before, in the world; NaN if not known", FINITE_OR_UNKNOWN
        ),
        "carries/end": Field(
            "float64 carry 3", "m", "where it is put down; NaN if not known", FINITE_OR_UNKNOWN
        ),
        "carries/size": Field(
            "float64 carry", "m", "side of a square as large as its masks, their median", FINITE
        ),
        "carries/best_frame": Field("int64 carry", "index", "frame that shows most of it", COUNT),
        "carries/box": Field("int32 carry 4", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "carries/feature": Field(
            "float32 carry channel",
            "-",
            "mean of OpenCLIP's features of its views and of those of carries that look alike, of unit norm; zeros without views",
            ANY,
        ),
        "carries/thing": Field(
            "int32 carry",
            "index",
            "the thing that each carry moves, -1 for none that rests",
            index_or_none("thing"),
        ),
        "carries/from_rest": Field(
            "int32 carry", "index", "rest before each carry, -1 for none", index_or_none("rest")
        ),
        "carries/to_rest": Field(
            "int32 carry", "index", "rest after each carry, -1 for none", index_or_none("rest")
        ),
        "rests/thing": Field("int32 rest", "index", "the thing that rests", index_of("thing")),
        "rests/from_frame": Field("int64 rest", "index", "first frame that shows it there", COUNT),
        "rests/until_frame": Field("int64 rest", "index", "last frame that shows it there", COUNT),
        "rests/absent_before": Field(
            "int64 rest",
            "index",
            "last frame before that shows the place without it, -1 for none",
            Values(least=-1),
        ),
        "rests/absent_after": Field(
            "int64 rest",
            "index",
            "first frame after that shows the place without it, -1 for none",
            Values(least=-1),
        ),
        "rests/center": Field("float64 rest 3", "m", "middle of its Gaussians, in the world", FINITE),
        "rests/size": Field("float64 rest", "m", "as that of its carries, their median", FINITE),
        "rests/gain": Field(
            "float32 rest",
            "0..1",
            "share of the error of the pixels that its Gaussians change, in these frames, which they explain",
            SHARE,
        ),
        "rests/best_frame": Field("int64 rest", "index", "frame that shows most of it", COUNT),
        "rests/box": Field("int32 rest 4", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "things/feature": Field(
            "float32 thing channel",
            "-",
            "mean of OpenCLIP's features of a thing's rests and carries, of unit norm; zeros without views",
            ANY,
        ),
        "gaussians/rest": Field("int32 gaussian", "index", "rest", index_of("rest")),
        "gaussians/means": Field("float32 gaussian 3", "m", "as in splats.zarr"),
        "gaussians/quats": Field("float32 gaussian 4", "-", "as in splats.zarr"),
        "gaussians/log_scales": Field("float32 gaussian 3", "log m", "as in splats.zarr"),
        "gaussians/logit_opacities": Field("float32 gaussian", "logit", "as in splats.zarr"),
        "gaussians/sh": Field("float32 gaussian coefficient 3", "sRGB 0..1", "as in splats.zarr"),
    },
)

# Every kind of artifact, by name.
_ALL = (FRAMES, ANNOTATIONS, POSES, TRANSIENT, SEGMENTS, INSTANCES, VIEW_FEATURES, FEATURES, MASKS)
SCHEMAS: dict[str, Schema] = {schema.name: schema for schema in (*_ALL, SPLATS, TILES, LANGUAGE, HISTORIES)}
