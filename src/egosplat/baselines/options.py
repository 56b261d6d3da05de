"""Options of the stages that only methods of others need."""

from typing import Literal

from egosplat.evaluation.options import ScoringOptions
from egosplat.pipeline.shared_options import (
    BackendOptions,
    ClipOptions,
    DeviceOptions,
    Sam2Options,
    SeedOptions,
)
from egosplat.query.options import MapOptions


class TilesOptions(ClipOptions, Sam2Options, DeviceOptions):
    """OpenCLIP features of tiles of each training frame, for the methods of others that use no masks."""

    regulariser: Literal["sam2", "none"] = "sam2"
    """What the methods learn beside the features of tiles. LERF and LEGaussians take DINO. sam2: the map of SAM2's
    image encoder, its 64 principal components. none: nothing, as in LERF's ablation."""


class PromptsOptions(BackendOptions, SeedOptions):
    """Where points are placed by depth."""


class MethodMetricsOptions(ScoringOptions, MapOptions):
    """How another method's maps are read and scored."""
