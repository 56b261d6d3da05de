"""The ways to give Gaussians codes, by value of ``language.method``; docs/methods.md says how to add one."""

from collections.abc import Callable

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.baselines.gags import granular
from egosplat.baselines.langsplat_v2 import sparse
from egosplat.baselines.legaussians import quantized
from egosplat.baselines.lerf import field
from egosplat.baselines.occam import centered
from egosplat.baselines.semantic_gaussians import projected
from egosplat.baselines.splat_feature_solver import clustered
from egosplat.baselines.tile_views import TileViews
from egosplat.codes.targets import CodeTargets
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.language.dominant import lifted
from egosplat.language.options import LanguageOptions
from egosplat.language.result import Coded
from egosplat.language.training import trained
from egosplat.language.views import CodeViews

# Gives codes to Gaussians that require no gradients, from views with targets. A method that trains resumes from the
# checkpoint, and raises UserError if it diverges.
Method = Callable[
    [Gaussians, CodeViews, RenderSettings, CodeTargets, LanguageOptions, Checkpoint],
    Coded,
]

METHODS: dict[str, Method] = {
    "lifted": lifted,
    "trained": trained,
    "projected": projected,
    "center": centered,
    "clustered": clustered,
    "granular": granular,
    "sparse": sparse,
}

# The same, from the tiles of views instead of instances.
TileMethod = Callable[
    [Gaussians, CodeViews, RenderSettings, TileViews, LanguageOptions, Checkpoint],
    Coded,
]

TILE_METHODS: dict[str, TileMethod] = {"field": field, "quantized": quantized}

_SAM = "{} in place of SAM"
# What the masks replace in a published method; {} is the segmenter.
_MASKS = dict.fromkeys(("trained", "center", "clustered", "granular", "sparse"), _SAM)
_MASKS["projected"] = "{} + OpenCLIP features in place of OpenSeg"
_SEGMENTERS = {"sam2": "SAM2", "classical": "a classical segmenter"}


def masks_stand_in(method: str, segmenter: str) -> tuple[str, ...]:
    """The stand-in of the masks of a published method, by value of ``segments.segmenter``; none without masks."""
    return (_MASKS[method].format(_SEGMENTERS[segmenter]),) if method in _MASKS else ()
