"""Expected time of a scene's main job, from the cost model."""

from collections.abc import Mapping

from egosplat.cost_model.laws import CPU, is_assumed, law_of, seconds, table
from egosplat.cost_model.sizes import Sizes
from egosplat.pipeline.config import Config
from egosplat.pipeline.dag import leaves_frames_out, masks_by_survey

PARTS = {
    "filming": ("synthetic",),
    "reading": ("frames", "annotations", "poses", "survey"),
    "segments": ("segments",),
    "features": ("view_features", "features"),
    "transient": ("transient", "masks"),
    "training": ("splats",),
    "queries": ("language", "metrics"),
}
"""The parts of the main job, and the stages of each. Report pages and tables are not included."""

_MODELS = frozenset({"segments", "view_features", "metrics"})
_RENDERS = frozenset({"transient", "splats", "language", "metrics"})


def estimate(
    config: Config, synthetic: bool, rasterizer: str, models_on: str = "cpu"
) -> dict[str, float | None]:
    """Expected seconds of each part of a scene's main job, on two cores.

    Args:
        config: the scene's whole configuration.
        synthetic: whether its recording is synthetic. The length of a real one is unknown before it is read.
        rasterizer: the variant of the C++ kernels that renders; for other backends no times were measured.
        models_on: the type of the device that runs SAM2 and OpenCLIP.

    Returns:
        Seconds by part; 0 where the part is not needed, None where nothing was measured.
    """
    sizes = Sizes(config, given=_known(config, synthetic))
    skipped = _skipped(config, synthetic)
    measured = rasterizer in table()["rasterizer"]

    def of_stage(stage: str) -> float | None:
        law = law_of(stage, config, colmap=config["poses"]["method"] == "colmap")
        if is_assumed(law, CPU) or (stage in _MODELS and models_on != "cpu"):
            return None
        if stage in _RENDERS and not measured:
            return None
        try:
            return seconds(law, sizes, rasterizer if measured else "avx512")
        except LookupError:  # the number of frames
            return None

    def of_part(stages: tuple[str, ...]) -> float | None:
        found = [of_stage(stage) for stage in stages if stage not in skipped]
        return None if None in found else sum(found)

    return {part: of_part(stages) for part, stages in PARTS.items()}


def _known(config: Config, synthetic: bool) -> Mapping[str, float]:
    film, frames = config["synthetic"], config["frames"]
    known: dict[str, float] = {"pixels": frames["resolution"] ** 2}
    if synthetic:
        known["frames"] = film["seconds"] * film["fps"] / frames["stride"]
        known["recorded_pixels"] = film["size"] ** 2
    return known


def _skipped(config: Config, synthetic: bool) -> set[str]:
    """Stages that the scene does not need."""
    skipped = set() if synthetic else {"synthetic"}
    if config["splats"]["masking"] == "none":
        skipped |= {"transient", "masks"}
    if not (masks_by_survey(config) or leaves_frames_out(config)):
        skipped.add("survey")
    return skipped


def duration(seconds: float) -> str:
    """``40 s``, ``12 min`` or ``3.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.3g} h"
