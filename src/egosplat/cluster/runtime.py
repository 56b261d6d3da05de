"""Time that a stage takes, as a law of the scene's size: what a scheduler may stop it after.

The laws are of processors alone, three times what was measured on two of them (``egosplat.doctor.times``,
benchmarks/segments_growth.md, published_models.md, docs/scale.md); with a GPU they are far too long, and an early end
costs nothing. No law asks for more than a day: trainings and encodings go on from their last checkpoint when they are
submitted again.
"""

from collections.abc import Callable

from egosplat.cluster.memory import LEVELS, PUBLISHED_SIDE, SMALL_SIDE, sam2_input_side
from egosplat.cluster.shapes import Shapes
from egosplat.doctor.times import ITERATION_S, estimate
from egosplat.models.configs import SMALL
from egosplat.pipeline.config import Config

MARGIN = 3.0
"""Slower machines, and file systems that are busy."""

LEAST_S = 600.0
"""Of any stage: Python and its libraries start slowly from a network file system."""

MOST_S = 86_400.0

SEGMENTS_FRAME_S, SEGMENTS_VIEW_S = 0.18, 0.016
"""The small SAM2, for a frame, and for an instance in a frame."""

SAM2_FRAME_S, SAM2_VIEW_S = 9.7, 3.2
"""The paper's SAM2; the second with its memory full, half of what docs/scale.md has of one processor."""

SAM2_VIEW_ON_GPU_S = 0.13
"""The same with a GPU: no measurement, but four times what docs/scale.md assumes there."""

CROP_S = 0.46
"""The paper's OpenCLIP, for a crop; the small one is faster."""


def expected_s(stage: str, config: Config, shapes: Shapes) -> float:
    """Seconds after which a job of the stage may be stopped.

    Args:
        stage: one of ``STAGES``.
        config: the scene's whole configuration.
        shapes: of the job's inputs.

    Raises:
        FileNotFoundError, LookupError: see ``Shapes``.
    """
    law = _LAWS.get(stage, _brief)
    return min(LEAST_S + MARGIN * law(config, shapes), MOST_S)


def _brief(_: Config, __: Shapes) -> float:
    """Pictures, and what is computed of a few arrays."""
    return 400.0


def _synthetic(config: Config, _: Shapes) -> float:
    return estimate(config, True, "none").synthetic


def _reading(config: Config, _: Shapes) -> float:
    """Frames are not known before they are read: as if there were 3,600, a minute of ADT and two of HOI4D."""
    return 3600 * 0.03 * (config["frames"]["resolution"] / 512) ** 2


def _poses(_: Config, shapes: Shapes) -> float:
    """COLMAP; a trajectory is read in seconds."""
    return 20.0 * shapes.frames


def _segments(config: Config, shapes: Shapes) -> float:
    """Half of all instances that may be followed, in every frame."""
    followed = LEVELS * config["segments"]["max_instances"] / 2
    if config["models"]["sam2_config"] == SMALL:
        frame, view, side = SEGMENTS_FRAME_S, SEGMENTS_VIEW_S, SMALL_SIDE
    else:
        on_cpu = config["models"]["device"] == "cpu"
        frame, view, side = SAM2_FRAME_S, SAM2_VIEW_S if on_cpu else SAM2_VIEW_ON_GPU_S, PUBLISHED_SIDE
    return shapes.frames * (frame + view * followed) * (sam2_input_side(config) / side) ** 2


def _view_features(config: Config, shapes: Shapes) -> float:
    views = shapes.instances * min(shapes.frames / 2, config["view_features"]["max_views"] or shapes.frames)
    return CROP_S * views / 2


def _transient(config: Config, _: Shapes) -> float:
    """An iteration and the network's."""
    return config["transient"]["iterations"] * (0.15 + ITERATION_S["generic"] * _load(config, "transient"))


def _splats(config: Config, _: Shapes) -> float:
    return config["splats"]["iterations"] * ITERATION_S["generic"] * _load(config, "splats")


def _load(config: Config, section: str) -> float:
    """Of an iteration, against one of 100,000 Gaussians."""
    return 0.3 + 0.7 * config[section]["max_gaussians"] / 100_000


def _language(config: Config, shapes: Shapes) -> float:
    """A pass over all views, or as many as are trained with, of a second each at 512 x 512."""
    keys = config["language"]
    passes = shapes.frames + (keys["iterations"] if keys["method"] == "trained" else 0)
    return passes * (shapes.pixels / 512**2 + shapes.gaussians / 100_000)


_LAWS: dict[str, Callable[[Config, Shapes], float]] = {
    "synthetic": _synthetic,
    "frames": _reading,
    "poses": _poses,
    "segments": _segments,
    "view_features": _view_features,
    "transient": _transient,
    "splats": _splats,
    "language": _language,
    "metrics": lambda *_: 1800.0,
}
