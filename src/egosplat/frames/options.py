"""Options of the stages ``frames`` and ``annotations``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import READING, Auto, Count, Natural, Options, Positive


class FramesOptions(Options):
    """Decoding and rectification of the recording's frames."""

    resolution: Annotated[int, Field(ge=32, le=8192)] = 512
    """Frame size in pixels: the side of the square (Aria), the width (HOI4D) or the longer side (plain). A smaller
    plain recording keeps its own size, a smaller HOI4D one is an error, and a smaller Aria one is enlarged. The paper
    uses 1408 for ADT. Time and memory of all later stages grow with its square."""

    upright: bool = True
    """Rotate Aria frames upright, by the angle in the device's calibration: 90 degrees for gen1, whose sensor is
    mounted sideways, none for gen2. CLIP is not invariant to rotation (docs/method.md#upright)."""

    stride: Count = 1
    """Use every N-th frame. Larger is faster and gives fewer views."""

    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Start time in seconds after the recording's first frame."""

    end_s: Positive | None = None
    """End time in seconds after the recording's first frame. null is the end of the recording."""

    evaluation_frames: Natural | Auto = "auto"
    """Number of frames that the benchmark scores, equally spaced in the recording
    (docs/method.md#evaluation-frames). auto is 12, or a sixth of the frames if there are fewer than 72. For a plain
    recording without annotations auto is 0, so that all frames train. For the benchmarks lerf and 3d_ovs they are
    taken from the labeled frames, and auto is all of these."""

    holdout: Annotated[bool, READING] = True
    """Leave the evaluation frames out of training. The paper does not say whether it does (docs/method.md#holdout).
    Training on them raises all scores."""

    storage: Literal["exact", "jpeg"] = "exact"
    """How frames.zarr holds pixels. jpeg, of quality 95, takes a fifth of the disk, for a recording of hours."""

    known_poses: Literal["auto", "colmap", "transforms", "none"] = "auto"
    """File of a plain recording with its calibration and poses (docs/recordings.md). colmap: the folder colmap or
    sparse/0, a COLMAP model. transforms: transforms.json. auto: whichever exists. none: neither."""

    lens: Literal["auto", "pinhole"] = "auto"
    """Whether frames of a plain recording without a calibration are rectified from radial distortion that COLMAP
    estimates from up to 30 of them. auto: if the frames ask for it (docs/recordings.md). pinhole: never."""


class AnnotationsOptions(Options):
    """Ground-truth instance maps of the evaluation frames. Training never uses them."""
