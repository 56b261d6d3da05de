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

# ``frames.zarr``: the frames of a recording, and how they lie.
FRAMES = Schema(
    "frames",
    1,
    {
        "rgb": Field(("frame", "height", "width", 3), "uint8", "sRGB", "rectified pictures", by_row=True),
        "valid": Field(("height", "width"), "bool", "-", "pixels inside the lens circle"),
        "masked": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "valid pixels that a frame's own mask or transparency leaves out",
            by_row=True,
            optional=True,
        ),
        "timestamp_ns": Field(("frame",), "int64", "ns", "capture time"),
        "exposure_middle_ns": Field(("frame",), "int64", "ns", "middle of the exposure; poses belong to it"),
        "train": Field(("frame",), "bool", "-", "frames to train on"),
        "evaluation": Field(("frame",), "bool", "-", "frames to evaluate on"),
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
        "frame": Field(
            ("evaluation",), "int64", "index", "index of the evaluation frame in frames.zarr", values=COUNT
        ),
        "annotated": Field(("evaluation",), "bool", "-", "whether the frame has an annotation"),
        "instance_map": Field(
            ("evaluation", "height", "width"),
            "int32",
            "index",
            "index into the instances of the facts, -1 where nothing is annotated",
            by_row=True,
            values=index_or_none("instances"),
        ),
        "covered_map": Field(
            ("evaluation", "layer", "height", "width"),
            "int32",
            "index",
            "the same for the instances that others cover in part, whole, in as many layers as they need",
            by_row=True,
            optional=True,
            values=index_or_none("instances"),
        ),
    },
)


# ``poses.zarr``: camera poses and points.
POSES = Schema(
    "poses",
    1,
    {
        "camera_to_world": Field(
            ("frame", 4, 4), "float64", "m", "OpenCV axes; NaN where not registered", values=POSES_OR_UNKNOWN
        ),
        "registered": Field(("frame",), "bool", "-", "frames that have a pose"),
        "intrinsics": Field(
            (3, 3), "float64", "px", "pinhole matrix, pixel centers at + 0.5", values=PINHOLE
        ),
        "up": Field((3,), "float64", "-", "unit vector against gravity, in the world", values=UNIT_VECTOR),
        "points/xyz": Field(("point", 3), "float64", "m", "points of the scene, in the world"),
        "points/rgb": Field(("point", 3), "uint8", "sRGB", "their colors"),
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
            ("frame", "height", "width"),
            "float16",
            "0..1",
            "the network's probability that the pixel is of something transient, of frames without a pose too",
            by_row=True,
            values=SHARE,
        ),
        "stands_out": Field(
            ("frame", "height", "width"),
            "bool",
            "-",
            "pixels whose squared difference to the temporary Gaussians after the warm-up exceeds 3.5 medians of their frame; "
            "false in frames without residual_scale",
            by_row=True,
        ),
        "compared": Field(
            ("height", "width"), "bool", "-", "pixels that stands_out speaks of: inside the lens circle"
        ),
        "residual_scale": Field(
            ("frame",),
            "float32",
            "squared sRGB in 0..1",
            "median squared difference of the frame to the temporary Gaussians after the warm-up; NaN if it was not measured: "
            "not trained on, or penalty_unit is absolute",
            values=SCALE_OR_UNKNOWN,
        ),
        "weights": Field(
            ("number",), "float32", "-", "the network's tensors, flat, one after the other; facts name them"
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record", values=COUNT
        ),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before", values=ANY
        ),
        "curve/probability": Field(
            ("record",),
            "float64",
            "0..1",
            "mean probability in the same iterations; 0 in the warm-up",
            values=SHARE_OR_UNKNOWN,
        ),
    },
)


# The arrays that instances.zarr has, too.
LABELED = {
    "labels": Field(
        ("frame", "level", "height", "width"),
        "int32",
        "index",
        "instance that the pixel belongs to at the level, -1 for none; levels as the facts name them",
        by_row=True,
        values=index_or_none("instance"),
    ),
    "instances/level": Field(
        ("instance",),
        "int8",
        "index",
        "level of the instance; it is seen at no other",
        values=index_of("level"),
    ),
}

# ``segments.zarr``: instances at up to three levels, tracked through the video.
SEGMENTS = Schema(
    "segments",
    2,
    {
        **LABELED,
        "instances/predicted_iou": Field(
            ("instance",),
            "float32",
            "0..1",
            "IoU that SAM2 predicts for the mask that began it; 1 without SAM2",
            values=FINITE,
        ),
        "instances/stability": Field(
            ("instance",),
            "float32",
            "0..1",
            "IoU of that mask cut a little higher and lower; 1 without SAM2",
            values=SHARE,
        ),
        "instances/first_frame": Field(
            ("instance",), "int64", "index", "frame whose prompts began it", values=COUNT
        ),
        "instances/moving": Field(
            ("instance",), "bool", "-", "tracked, because the transient network says that it moves"
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
            ("instance",),
            "int32",
            "index",
            "instance of the next coarser level that holds most of it in 3D, -1 for none",
            values=index_or_none("instance"),
        ),
        "instances/masks": Field(
            ("instance",),
            "int32",
            "count",
            "masks of segments.zarr that are merged in it; of what moves, the frames that show it; else 1 for a track",
            values=COUNT,
        ),
        "instances/moving": Field(
            ("instance",), "bool", "-", "a track of segments.zarr of something that moves, not merged in 3D"
        ),
        "gaussians/xyz": Field(
            ("gaussian", 3), "float32", "m", "centers of the Gaussians that masks are merged on"
        ),
        "gaussians/instance": Field(
            ("gaussian", "level"),
            "int32",
            "index",
            "instance that the Gaussian belongs to at the level, -1 for none",
            values=index_or_none("instance"),
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
            ("view",),
            "int32",
            "index",
            "instance in segments.zarr; rows go by instance, then frame",
            values=index_of("instance"),
        ),
        "frame": Field(
            ("view",), "int32", "index", "frame in frames.zarr; training frames alone", values=COUNT
        ),
        "feature": Field(
            ("view", "channel"),
            "float32",
            "-",
            "OpenCLIP's of the crop, of unit norm",
            by_row=2048,
            values=ANY,
        ),
        "area": Field(("view",), "int32", "px", "pixels of the instance's mask in the frame", values=COUNT),
        "box": Field(("view", 4), "int32", "px", "x0, y0, x1, y1 around the mask, the ends exclusive"),
        "instances/level": Field(
            ("instance",), "int8", "index", "level of each instance, views or none", values=index_of("levels")
        ),
    },
)


# ``features.zarr``: aggregated features of instances, supervision of views, codes, decoder.
FEATURES = Schema(
    "features",
    1,
    {
        "consistent": Field(
            ("instance", "channel"),
            "float32",
            "-",
            "aggregated over the inlier views; 0 where there is no view",
        ),
        "views": Field(
            ("instance",), "int32", "count", "views that were aggregated, outliers among them", values=COUNT
        ),
        "instances/level": Field(
            ("instance",), "int8", "index", "level of each instance", values=index_of("levels")
        ),
        "instance": Field(
            ("view",),
            "int32",
            "index",
            "instance; the rows of view_features.zarr",
            values=index_of("instance"),
        ),
        "frame": Field(("view",), "int32", "index", "frame in frames.zarr", values=COUNT),
        "inlier": Field(("view",), "bool", "-", "views that agree with their instance's median"),
        "supervision": Field(
            ("view", "channel"), "float32", "-", "what the instance means in the frame", by_row=2048
        ),
        "code": Field(("view", "code"), "float32", "-", "supervision, compressed", by_row=65536),
        "consistent_code": Field(("instance", "code"), "float32", "-", "consistent, compressed"),
        "decoder/values": Field(
            ("number",),
            "float32",
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
            ("frame", "height", "width"),
            "bool",
            "-",
            "pixels of a transient instance, of any level that is asked for, where the network calls them transient, "
            "and of regions that the network is sure of for several frames",
            by_row=True,
        ),
        "instances/score": Field(
            ("instance",),
            "float32",
            "0..1",
            "mean probability over all pixels of the instance in the training frames; 0 without any pixel",
            values=SHARE,
        ),
        "instances/stands_out": Field(
            ("instance",),
            "float32",
            "0..1",
            "share of the instance's pixels that stand out (transient.zarr), in training frames where this was measured",
            values=SHARE,
        ),
        "instances/transient": Field(
            ("instance",),
            "bool",
            "-",
            "transient by score and by what stands out, at a level that is asked for",
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
        "means": Field(("gaussian", 3), "float32", "m", "centers, in the world of poses.zarr"),
        "quats": Field(("gaussian", 4), "float32", "-", "rotations to the world, wxyz, of any length but 0"),
        "log_scales": Field(
            ("gaussian", 3), "float32", "log m", "natural logarithm of the standard deviations"
        ),
        "logit_opacities": Field(("gaussian",), "float32", "logit", "opacity = 1 / (1 + exp(-logit))"),
        "sh": Field(
            ("gaussian", "coefficient", 3),
            "float32",
            "sRGB 0..1",
            "spherical harmonics of the direction from camera to center, 3DGS's order; color = max(sum + 0.5, 0)",
        ),
        "features": Field(
            ("gaussian", "channel"),
            "float32",
            "-",
            "codes of all levels, side by side, where they were trained with the geometry; else no column",
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record", values=COUNT
        ),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before", values=ANY
        ),
        "curve/gaussians": Field(
            ("record",), "int64", "count", "Gaussians after that iteration", values=COUNT
        ),
        "history/iteration": Field(
            ("evaluation",), "int64", "iteration", "when Gaussians were evaluated", values=COUNT
        ),
        "history/psnr": Field(
            ("evaluation",), "float64", "dB", "mean over the held-out frames; NaN without any", values=ANY
        ),
        "history/ssim": Field(
            ("evaluation",),
            "float64",
            "-",
            "mean over the held-out frames; NaN without any",
            values=FINITE_OR_UNKNOWN,
        ),
        "held_out/frame": Field(
            ("frame",), "int64", "index", "held-out frame's index in frames.zarr", values=COUNT
        ),
        "held_out/psnr": Field(
            ("frame",), "float64", "dB", "of the Gaussians stored here, valid pixels only", values=ANY
        ),
        "held_out/ssim": Field(
            ("frame",),
            "float64",
            "-",
            "the same; NaN where no whole window is valid",
            values=FINITE_OR_UNKNOWN,
        ),
        "held_out/render": Field(
            ("frame", "height", "width", 3), "uint8", "sRGB", "the held-out frames, rendered", by_row=True
        ),
        # Only where poses or exposures are corrected. The scores and renders above are those after correction.
        "held_out/psnr_given": Field(
            ("frame",), "float64", "dB", "with the poses of poses.zarr and no gain", optional=True, values=ANY
        ),
        "held_out/ssim_given": Field(
            ("frame",), "float64", "-", "the same", optional=True, values=FINITE_OR_UNKNOWN
        ),
        "held_out/render_given": Field(
            ("frame", "height", "width", 3), "uint8", "sRGB", "the same", by_row=True, optional=True
        ),
        "corrections/camera_to_world": Field(
            ("recorded_frame", 4, 4),
            "float64",
            "m",
            "poses of all frames after correction, OpenCV axes; NaN where not registered",
            optional=True,
            values=POSES_OR_UNKNOWN,
        ),
        "corrections/source": Field(
            ("recorded_frame",),
            "int8",
            "-",
            "0 as in poses.zarr, 1 trained, 2 held out and fitted afterwards, 3 between frames that were trained",
            optional=True,
            values=Values(least=AS_GIVEN, most=INTERPOLATED),
        ),
        "corrections/shift": Field(
            ("recorded_frame", 3),
            "float64",
            "m",
            "from the camera's center in poses.zarr to that after correction, in the world",
            optional=True,
            values=FINITE_OR_UNKNOWN,
        ),
        "corrections/turn": Field(
            ("recorded_frame",),
            "float64",
            "deg",
            "angle between the orientations before and after",
            optional=True,
            values=SCALE_OR_UNKNOWN,
        ),
        "corrections/gain": Field(
            ("recorded_frame", 3),
            "float64",
            "-",
            "factor of red, green and blue from the Gaussians' render to the frame",
            optional=True,
            values=SCALE_OR_UNKNOWN,
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
            ("gaussian", "level", "channel"),
            "float32",
            "-",
            "code, for the artifact's own decoder or that of features.zarr; 0 where the share is 0; levels as the facts name them",
        ),
        "share": Field(
            ("gaussian", "level"),
            "float32",
            "0..1",
            "share of what the Gaussian shows in the training views at which the level has an instance with a code",
            values=SHARE,
        ),
        "decoder/values": Field(
            ("number",),
            "float32",
            "-",
            "as in features.zarr, of a decoder that the method learns",
            optional=True,
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record of training", values=COUNT
        ),
        "curve/loss": Field(
            ("record",),
            "float64",
            "-",
            "mean loss of the iterations since the record before; none if not trained",
            values=ANY,
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
            ("carry",), "int32", "index", "track in instances.zarr that shows most of it", values=COUNT
        ),
        "carries/first_frame": Field(
            ("carry",), "int64", "index", "frame in which it leaves its place", values=COUNT
        ),
        "carries/last_frame": Field(
            ("carry",),
            "int64",
            "index",
            "frame from which it lies still again, or the last that shows it",
            values=COUNT,
        ),
        "carries/start": Field(
            ("carry", 3),
            "float64",
            "m",
            "where it lay before, in the world; NaN if not known",
            values=FINITE_OR_UNKNOWN,
        ),
        "carries/end": Field(
            ("carry", 3), "float64", "m", "where it is put down; NaN if not known", values=FINITE_OR_UNKNOWN
        ),
        "carries/size": Field(
            ("carry",), "float64", "m", "side of a square as large as its masks, their median", values=FINITE
        ),
        "carries/best_frame": Field(
            ("carry",), "int64", "index", "frame that shows most of it", values=COUNT
        ),
        "carries/box": Field(
            ("carry", 4), "int32", "px", "x0, y0, x1, y1 around it there, the ends exclusive"
        ),
        "carries/feature": Field(
            ("carry", "channel"),
            "float32",
            "-",
            "mean of OpenCLIP's features of its views and of those of carries that look alike, of unit norm; zeros without views",
            values=ANY,
        ),
        "carries/thing": Field(
            ("carry",),
            "int32",
            "index",
            "the thing that each carry moves, -1 for none that rests",
            values=index_or_none("thing"),
        ),
        "carries/from_rest": Field(
            ("carry",), "int32", "index", "rest before each carry, -1 for none", values=index_or_none("rest")
        ),
        "carries/to_rest": Field(
            ("carry",), "int32", "index", "rest after each carry, -1 for none", values=index_or_none("rest")
        ),
        "rests/thing": Field(("rest",), "int32", "index", "the thing that rests", values=index_of("thing")),
        "rests/from_frame": Field(
            ("rest",), "int64", "index", "first frame that shows it there", values=COUNT
        ),
        "rests/until_frame": Field(
            ("rest",), "int64", "index", "last frame that shows it there", values=COUNT
        ),
        "rests/absent_before": Field(
            ("rest",),
            "int64",
            "index",
            "last frame before that shows the place without it, -1 for none",
            values=Values(least=-1),
        ),
        "rests/absent_after": Field(
            ("rest",),
            "int64",
            "index",
            "first frame after that shows the place without it, -1 for none",
            values=Values(least=-1),
        ),
        "rests/center": Field(
            ("rest", 3), "float64", "m", "middle of its Gaussians, in the world", values=FINITE
        ),
        "rests/size": Field(("rest",), "float64", "m", "as that of its carries, their median", values=FINITE),
        "rests/gain": Field(
            ("rest",),
            "float32",
            "0..1",
            "share of the error of the pixels that its Gaussians change, in these frames, which they explain",
            values=SHARE,
        ),
        "rests/best_frame": Field(("rest",), "int64", "index", "frame that shows most of it", values=COUNT),
        "rests/box": Field(("rest", 4), "int32", "px", "x0, y0, x1, y1 around it there, the ends exclusive"),
        "things/feature": Field(
            ("thing", "channel"),
            "float32",
            "-",
            "mean of OpenCLIP's features of a thing's rests and carries, of unit norm; zeros without views",
            values=ANY,
        ),
        "gaussians/rest": Field(("gaussian",), "int32", "index", "rest", values=index_of("rest")),
        "gaussians/means": Field(("gaussian", 3), "float32", "m", "as in splats.zarr"),
        "gaussians/quats": Field(("gaussian", 4), "float32", "-", "as in splats.zarr"),
        "gaussians/log_scales": Field(("gaussian", 3), "float32", "log m", "as in splats.zarr"),
        "gaussians/logit_opacities": Field(("gaussian",), "float32", "logit", "as in splats.zarr"),
        "gaussians/sh": Field(("gaussian", "coefficient", 3), "float32", "sRGB 0..1", "as in splats.zarr"),
    },
)
