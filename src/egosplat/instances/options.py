"""Options of the stage ``instances``."""

from dataclasses import dataclass

from egosplat.gaussians.camera_options import CameraOptions


@dataclass(frozen=True)
class InstancesOptions(CameraOptions):
    """Configuration keys of the stage; ``config.schema.yaml`` describes each."""

    source: str
    resolution: int
    iterations: int
    inside: float
    cut_iou: float
    merge_iou: float
    common: float
    drop_iou: float
    claimed: float
    backend: str
    seed: int
    near_plane: float
