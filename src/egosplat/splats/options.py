"""Options of the stage ``splats``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import READING, Count, Text
from egosplat.pipeline.shared_options import BackendOptions, CameraOptions, NearPlaneOptions, SeedOptions


class SplatsOptions(CameraOptions, SeedOptions, BackendOptions, NearPlaneOptions):
    """Training of the 3D Gaussians."""

    masking: Literal["auto", "none", "initial", "refined"] = "auto"
    """Pixels that training leaves out because they move. refined: transient instances, as in the paper. initial:
    the network's probability alone, as in EgoLifter. none: no pixels; neither network nor instances are needed.
    auto: refined if the survey finds motion, else none."""

    source: Text | None = None
    """File of Gaussians that another program trained on the recording, .ply or .spz, so that nothing trains
    (docs/recordings.md#a-trained-splat). Relative to the working directory. null: train here."""

    language: Literal["after", "joint"] = "after"
    """When the Gaussians get their codes (docs/method.md#joint-or-after). after: in the stage language, with color
    and geometry fixed. joint: in one training with the sum of both losses, as in the paper. The codes then change
    the geometry, and every change of segments or features trains it again."""

    iterations: Count = 3000
    """Training iterations, one frame each. More add fine detail and take longer. 3DGS uses 30,000. The learning
    rate and the end of density control scale with it; the intervals of density control, opacity resets and
    spherical harmonics do not. On a synthetic apartment with 108 views, 3,000 with added points reach the PSNR
    of 7,000 without (27.9 and 28.0 dB)."""

    max_points: Count = 50000
    """Largest number of initial points; never more than max_gaussians. If there are more, a random subset is kept.
    If there are none, each image cell of up to 200 views gets a random one."""

    max_gaussians: Count = 100000
    """Largest number of Gaussians. More hold finer detail; memory grows with it, and time where many overlap a
    pixel."""

    sh_degree: Annotated[int, Field(ge=0, le=3)] = 3
    """Highest spherical-harmonics degree of view-dependent color. 0 is matt and takes a quarter of the memory; 3
    shows highlights."""

    recipe: Annotated[Literal["own", "paper"], READING] = "own"
    """How the Gaussians are trained (docs/method.md#starting-points). own: on black, with 3DGS's share of SSIM in the
    loss, opacities that are reset to 0.05, and added initial points where a training view shows none (windows, lamps,
    plain walls). paper: on white, by L1 alone, without added points, and as in 3DGS and EgoLifter opacities are reset to
    0.01, also when density control begins, and Gaussians of more than 20 pixels are pruned after a reset."""

    evaluate_every: Count = 1000
    """Iterations between two evaluations on the held-out frames. The scores are logged and stored and change
    nothing. Each evaluation renders every held-out frame and computes its SSIM. None is made just after opacities
    are reset."""
