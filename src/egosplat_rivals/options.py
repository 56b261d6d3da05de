"""Options of the stage ``tiles``, and of the pages that compare methods, presets and variants."""

import re
from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import UNIQUE, Options, Text, check_with
from egosplat.pipeline.shared_options import ClipOptions, DeviceOptions, Sam2Options

_SCENE = check_with(re.compile("[^/]+/[^/]+").fullmatch, "only dataset/scene")


class TilesOptions(ClipOptions, Sam2Options, DeviceOptions):
    """OpenCLIP features of tiles of each training frame, for the methods of others that use no masks."""

    regulariser: Literal["sam2", "none"] = "sam2"
    """What the methods learn beside the features of tiles. LERF and LEGaussians take DINO. sam2: the map of SAM2's
    image encoder, its 64 principal components. none: nothing, as in LERF's ablation."""


class TablesOptions(Options, section="tables"):
    """Rows of the paper's tables (results/benchmark/tables.html) besides those of EgoSplat and its ablation."""

    methods: Annotated[tuple[Text, ...], UNIQUE] = (
        *("lerf", "legaussians", "semantic_gaussians", "gags", "langsplat", "occam", "langsplat2"),
        *("splat_feature_solver", "no_sizes", "pixels", "semantic_gaussians_pixels", "gags_pixels"),
        *("langsplat_pixels", "occam_pixels", "langsplat2_pixels", "splat_feature_solver_pixels"),
    )
    """Variants whose scores the tables wait for, in each scene. Each stands in the row of its `method`
    (docs/methods.md). A run without a target does not make them."""


class TradeoffOptions(Options, section="tradeoff"):
    """Presets and variants that the page of speed against accuracy compares (tradeoff/tradeoff.html of a scene), and the scenes of results/benchmark/tradeoff.html."""

    scenes: Annotated[tuple[Annotated[str, _SCENE], ...], Field(min_length=1), UNIQUE] = (
        "adt/scene1",
        "adt/scene2",
    )
    """Scenes of the joint page, as dataset/scene."""

    variants: Annotated[tuple[Text, ...], UNIQUE] = ("draft", "quick", "balanced", "accurate", "paper_scaled")
    """Presets and variants to compare with the scene. Each preset is a variant with the scene's recording and models;
    paper_scaled is the preset paper at the scene's own resolution and focal length. One that changes nothing is left
    out."""
