"""Options of the stage ``poses``."""

from typing import Annotated, Literal

from egosplat.pipeline.options import READING, Options, Positive, Share


class PosesOptions(Options):
    """Camera poses, and the points that initialize the Gaussians."""

    method: Literal["auto", "colmap"] = "auto"
    """Source of the poses. colmap: COLMAP on the frames. auto: the device's trajectory (ADT) or a file of a plain
    recording (frames.known_poses) if the recording has one, else COLMAP."""

    trajectory: Annotated[Literal["closed_loop", "ground_truth"], READING] = "closed_loop"
    """ADT trajectory. closed_loop: the output of Aria's machine perception (docs/method.md#trajectory).
    ground_truth: motion capture."""

    matching: Literal["auto", "exhaustive", "sequential"] = "auto"
    """Frame pairs that COLMAP matches. exhaustive: all pairs, most accurate, time grows with the square of the
    number of frames. sequential: neighbors in time. auto: exhaustive up to 30 frames."""

    min_registered: Share = 0.5
    """Smallest fraction of frames that COLMAP must register, or that known poses must cover. Below it the stage
    fails."""

    meters_per_unit: Positive | None = None
    """Meters of one unit of known poses. null: not known; lengths are in scene units."""
