"""Options of the stage ``tiles``."""

from typing import Literal

from egosplat.pipeline.shared_options import ClipOptions, DeviceOptions, Sam2Options


class TilesOptions(ClipOptions, Sam2Options, DeviceOptions):
    """OpenCLIP features of tiles of each training frame, for the methods of others that use no masks."""

    regulariser: Literal["sam2", "none"] = "sam2"
    """What the methods learn beside the features of tiles. LERF and LEGaussians take DINO. sam2: the map of SAM2's
    image encoder, its 64 principal components. none: nothing, as in LERF's ablation."""
