"""The time that a job will take, before anything of its scene is made."""

from collections.abc import Mapping

from egosplat.cost_model.laws import CPU, START_S, is_assumed, law_of, laws, renders, seconds, table
from egosplat.cost_model.sizes import Sizes
from egosplat.pipeline.config import Config
from egosplat.pipeline.stages import PAGES

# Time of a page, with the start of Python [s].
_PAGE_S = 10.0

_MODELS = frozenset({"segments", "view_features", "metrics"})


def expected_seconds(
    rule: str, config: Config, synthetic: bool, rasterizer: str = "avx512", models_on: str = "cpu"
) -> float | None:
    """Expected time of a rule's job on two cores [s].

    Args:
        rule: a stage, or a rule without a stage, which takes little more than the start of Python.
        synthetic: whether the recording is synthetic. The length of a real one is unknown before it is read.
        rasterizer: the variant of the C++ kernels that renders; for other backends no times were measured.
        models_on: the type of the device that runs SAM2 and OpenCLIP.

    Returns:
        None where nothing was measured.
    """
    if rule in PAGES:
        return _PAGE_S
    law = law_of(rule, config, colmap=config["poses"]["method"] == "colmap")
    if law not in laws():
        return START_S
    measured = rasterizer in table()["rasterizer"]
    # Nothing was measured on a GPU, nor with the published models: no time is better than a guess.
    if is_assumed(law, CPU) or (rule in _MODELS and models_on != "cpu"):
        return None
    if renders(law) and not measured:
        return None
    try:
        sizes = Sizes(config, given=_known(config, synthetic))
        return seconds(law, sizes, rasterizer if measured else "avx512")
    except LookupError:  # the number of frames
        return None


def _known(config: Config, synthetic: bool) -> Mapping[str, float]:
    film, frames = config["synthetic"], config["frames"]
    known: dict[str, float] = {"pixels": frames["resolution"] ** 2}
    if synthetic:
        known["frames"] = film["seconds"] * film["fps"] / frames["stride"]
        known["recorded_pixels"] = film["size"] ** 2
        # The survey finds what the camera's errors are.
        if "auto" in config["camera"].values() and "on" not in config["camera"].values():
            known["corrected"] = float(film["camera"] == "real" and film["camera_strength"] > 0)
    return known
