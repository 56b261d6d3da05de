"""Memory that a stage's process reaches, as a law of the scene's size.

Each law is what the stage starts from and what it holds at once. Sizes that a stage's inputs do not tell are the
configuration's budgets. The constants are rounded up from what was measured without a GPU: benchmarks/memory.md,
segments_growth.md, rasterizer.md, published_models.md.
"""

from collections.abc import Callable

from egosplat.cluster.shapes import Shapes
from egosplat.errors import UserError
from egosplat.models.checkpoints import CLIP, SAM2, Model, find_checkpoint
from egosplat.models.configs import sam2_side
from egosplat.pipeline.config import Config

MB = 1e6

PLAIN = 350.0
"""NumPy, OpenCV, Zarr, matplotlib and projectaria-tools, with a small picture in work [MB]."""

TORCH = 900.0
"""PyTorch, with a small picture in work [MB]."""

TRAINING = 1150.0
"""PyTorch with what trains, small pictures and few Gaussians [MB]."""

METRICS = 1050.0
"""PyTorch with OpenCLIP and what renders and scores, small pictures and few Gaussians [MB]."""

CHECKPOINT = 4.0
"""Times a checkpoint's file: reading it, the weights, and a picture's activations."""

GAUSSIAN = 1500.0
"""Bytes a Gaussian in training: 1.43 MiB a thousand, with gradients, Adam's moments and density control."""

SMALL_SIDE = 320
"""Of the square to which the small SAM2 resizes pictures where its growth was measured [px]."""

TRACKING, INSTANCE = 200.0, 1.9
"""The small SAM2: a batch in work, and of each instance the frames that are remembered [MB]."""

PUBLISHED_SIDE = 1024
"""Of the square to which the published SAM2 resize pictures [px]."""

LEVELS = 3
"""Of instances; no stage has more."""

DIMS = 32
"""Of codes, where features.dims leaves the number to the scene: more than scenes take."""


def peak_mb(stage: str, config: Config, shapes: Shapes) -> float:
    """Peak memory that a process of the stage is expected to reach without a GPU [MB].

    Args:
        stage: one of ``STAGES``.
        config: the scene's whole configuration.
        shapes: of the job's inputs.

    Raises:
        FileNotFoundError, LookupError: see ``Shapes``.
    """
    return _LAWS[stage](config, shapes)


def _dims(config: Config) -> int:
    """Numbers in a code; of ``auto``, more than scenes take."""
    dims = config["features"]["dims"]
    return DIMS if dims == "auto" else dims


def sam2_input_side(config: Config) -> int:
    """Side of the square that SAM2 looks at [px]; of one that cannot be told, the published ones': the stage says so best."""
    try:
        return config["segments"]["image_size"] or sam2_side(config["models"]["sam2_config"])
    except UserError:
        return PUBLISHED_SIDE


def _synthetic(config: Config, _: Shapes) -> float:
    return PLAIN + 500 * config["synthetic"]["size"] ** 2 / MB


def _frames(config: Config, _: Shapes) -> float:
    """A picture at a time; there are no frames yet that would tell its size."""
    return PLAIN + 200 * config["frames"]["resolution"] ** 2 / MB


def _a_picture_at_a_time(_: Config, shapes: Shapes) -> float:
    return PLAIN + 200 * shapes.pixels / MB


def _poses(config: Config, shapes: Shapes) -> float:
    """COLMAP: a picture a thread, in its octaves; of each frame at most 8,192 features of 128 bytes, and matches.

    From a device's trajectory far less, but a real recording's points are read whole.
    """
    return 3000 + 8 * 400 * shapes.pixels / MB + 4 * shapes.frames


def _segments(config: Config, shapes: Shapes) -> float:
    """SAM2 with what it works on and what it remembers of each instance that it may follow; compressed labels."""
    keys = config["segments"]
    if keys["segmenter"] == "classical":
        return TORCH + 200 * shapes.pixels / MB
    share = (sam2_input_side(config) / SMALL_SIDE) ** 2
    sam2 = share * (TRACKING + INSTANCE * LEVELS * keys["max_instances"])
    labels = 0.05 * LEVELS * 4 * shapes.frames * shapes.pixels / MB
    return TORCH + _checkpoint(SAM2, config) + sam2 + labels + 200 * shapes.pixels / MB


def _view_features(config: Config, shapes: Shapes) -> float:
    """Four copies of all features; of half the frames, at most, an instance is seen in."""
    views = shapes.instances * min(shapes.frames / 2, config["view_features"]["max_views"] or shapes.frames)
    return TORCH + _checkpoint(CLIP, config) + 4 * 512 * 4 * views / MB + 200 * shapes.pixels / MB


def _features(_: Config, shapes: Shapes) -> float:
    """Eight copies: what is given, aggregated, supervised with, encoded, decoded."""
    return TORCH + 8 * 4 * shapes.channels * shapes.views / MB


def _transient(config: Config, shapes: Shapes) -> float:
    """All training pictures at the working size, and the temporary Gaussians."""
    keys = config["transient"]
    pixels = min(keys["resolution"] ** 2, shapes.pixels)
    pictures = 3 * shapes.frames * pixels
    return TRAINING + (pictures + 400 * pixels + GAUSSIAN * keys["max_gaussians"] + 100 * shapes.pixels) / MB


def _splats(config: Config, shapes: Shapes) -> float:
    """All training pictures with their masks, and the Gaussians with all that they learn."""
    keys = config["splats"]
    codes = LEVELS * _dims(config) if keys["language"] == "joint" else 0
    pictures = 5 * shapes.frames * shapes.pixels
    gaussians = (GAUSSIAN + 20 * codes) * keys["max_gaussians"]
    return TRAINING + (pictures + gaussians + (150 + 20 * codes) * shapes.pixels) / MB


def _language(config: Config, shapes: Shapes) -> float:
    """Of each pixel and each Gaussian a code a level, their weights, and gradients of both."""
    channels = LEVELS * (_dims(config) + 1) + 1
    trained = 2 if config["language"]["method"] == "trained" else 1
    each = 20 * trained * channels
    return TORCH + (each * shapes.pixels + (500 + each) * shapes.gaussians) / MB


def _metrics(config: Config, shapes: Shapes) -> float:
    """Of each pixel the codes, and relevancies of up to a hundred queries at each level."""
    channels = LEVELS * (_dims(config) + 1) + 1
    pixels = (12 * channels + 100 * LEVELS * 4 * 2) * shapes.pixels
    return METRICS + _checkpoint(CLIP, config) + (pixels + (500 + 4 * channels) * shapes.gaussians) / MB


def _pictures_of_gaussians(_: Config, shapes: Shapes) -> float:
    return TORCH + (1000 * shapes.gaussians) / MB + 300


def _sheet(_: Config, shapes: Shapes) -> float:
    """Some pictures beside each other."""
    return PLAIN + 300 * shapes.pixels / MB


def _checkpoint(model: Model, config: Config) -> float:
    """What a model adds; of one that is not there, nothing: the stage says so best."""
    try:
        file = find_checkpoint(model, config["models"][model.checkpoint_key])
    except UserError:
        return 0.0
    return CHECKPOINT * file.stat().st_size / MB


_LAWS: dict[str, Callable[[Config, Shapes], float]] = {
    "synthetic": _synthetic,
    "frames": _frames,
    "annotations": _a_picture_at_a_time,
    "survey": _a_picture_at_a_time,
    "poses": _poses,
    "segments": _segments,
    "view_features": _view_features,
    "features": _features,
    "transient": _transient,
    "masks": _a_picture_at_a_time,
    "splats": _splats,
    "language": _language,
    "metrics": _metrics,
    "contact_sheet": _sheet,
    "segments_sheet": _sheet,
    "crops_sheet": _sheet,
    "splats_sheet": _sheet,
    "transient_sheet": _pictures_of_gaussians,
    "language_sheet": _pictures_of_gaussians,
    "queries_sheet": _metrics,
}
