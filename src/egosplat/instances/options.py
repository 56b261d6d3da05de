"""Options of the stage ``instances``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import Count
from egosplat.pipeline.shared_options import BackendOptions, CameraOptions, NearPlaneOptions, SeedOptions


class InstancesOptions(CameraOptions, BackendOptions, SeedOptions, NearPlaneOptions):
    """Instances that hold in 3D, merged from the masks of segments.zarr (docs/method.md#instances-3d)."""

    source: Literal["auto", "tracks", "masks"] = "auto"
    """What becomes an instance. tracks: the tracks of segments.zarr, unchanged, as in the paper. masks: the masks
    of each frame, merged where they cover the same surfaces; tracks are ignored. auto: masks if
    segments.prompting is each_frame, else tracks."""

    resolution: Annotated[int, Field(ge=32)] = 256
    """Longer side in pixels at which masks are lifted onto Gaussians and rendered. Larger keeps finer
    outlines; time grows with its square."""

    iterations: Count = 1000
    """Training length of temporary Gaussians, which masks are merged on where something is tracked or masked, or codes train jointly
    (docs/method.md#merged-on). Sharper surfaces give instances sharper outlines
    (benchmarks/instances/README.md)."""
