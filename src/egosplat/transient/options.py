"""Options of the stages ``transient`` and ``masks``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import READING, Count, Positive, Share, Text
from egosplat.pipeline.shared_options import (
    BackendOptions,
    CameraOptions,
    NearPlaneOptions,
    SeedOptions,
    ThresholdOptions,
)

# Keys of a training by transient.recipe. Gradients of squared differences are about ten times smaller than those that 3DGS's
# grow_grad2d of 0.0002 is chosen for: with it, and without added points, windows and lamps come so late that the network calls
# them transient. View-dependent color could fit what moves. EgoLifter has no limits; memory has.
TEMPORARY = {
    "own": {"max_points": 20_000, "max_gaussians": 60_000, "grow_grad2d": 2e-5},
    "paper": {"max_points": 1_000_000, "max_gaussians": 5_000_000, "sh_degree": 3, "cuts_schedule": True},
}

# Learning rate times trained iterations from which static pixels reach a low probability (benchmarks/ablation/README.md).
LEAST_REACH = 0.7


class TransientOptions(CameraOptions, SeedOptions, BackendOptions, NearPlaneOptions):
    """Network that predicts moving pixels, trained together with temporary Gaussians."""

    iterations: Count = 2000
    """Training iterations, one frame each, for the network and the temporary Gaussians. The paper uses 7,000. A
    network with random initial weights has learned little before 2,000."""

    warmup: Annotated[Share, READING] = 0.3
    """Fraction of iterations that train only the Gaussians, so that unfinished geometry is not mistaken for motion.
    Too long, and the Gaussians fit what moves. The paper mentions none."""

    resolution: Annotated[int, Field(ge=32)] = 128
    """Longer side in pixels at which frames and renders are compared; never larger than the frames. The paper
    compares at full resolution. Time grows with its square. It does not change the network's input (input_size)."""

    transient_penalty: Annotated[float, Field(ge=0), READING] = 2
    """Loss of a pixel that the network calls transient, in the unit of recipe; it does so if the residual is
    larger. Larger masks less. The paper prints 0.2 and EgoLifter uses 0.01, both absolute
    (docs/method.md#transient-loss). Median residuals are 0.9 to 1.0 units of static pixels, 3 to 12 of moving ones."""

    lr: Annotated[Positive, READING] = 0.001
    """Adam learning rate of the network. A weight moves by about as much an iteration: with the paper's 1e-5 and
    7,000 iterations by 0.07, which left all pixels near 0.5. The stage and egosplat doctor say so below 0.7."""

    input_size: Annotated[int, Field(ge=64, multiple_of=32)] = 96
    """Side in pixels of the square network input, a multiple of 32. EgoLifter uses 224. Small moving objects need a
    larger input; the network's time grows with its square."""

    encoder_weights: Text | None = None
    """Encoder weights of timm's mobilenetv3_small_050: published (EgoLifter's, from ImageNet, in the folder
    models.cache) or a .pt, .bin or .safetensors file. null starts from random weights."""

    recipe: Annotated[Literal["own", "paper"], READING] = "own"
    """How the network and the temporary Gaussians are trained (docs/method.md#temporary-gaussians). own: the unit of
    transient_penalty is the median squared difference of a frame to the Gaussians at the end of the warm-up, or the
    median of that over the frames if that is larger: it follows the camera's noise, blur, exposure and poses. The
    Gaussians are few, of one color each, on black, by a schedule that is scaled to the run; the network predicts by the
    statistics of the frame itself. paper: the unit is the squared sRGB difference in 0..1, summed over R, G and B,
    and masks.stands_out has no effect; the rest is as in EgoLifter, with 3DGS's schedule, cut off at the end of the
    run, and running averages."""

    def stays_at_start(self) -> str | None:
        """Say that the network will call static pixels transient, and what to set; None if it is trained long enough."""
        trained = self.iterations - round(self.warmup * self.iterations)
        if self.lr * trained >= LEAST_REACH:
            return None
        return (
            f"transient.lr {self.lr:g} x {trained} iterations = {self.lr * trained:.2g}. Below {LEAST_REACH} the network "
            "stays near its start: static pixels keep a probability of up to 0.5, and a lower masks.threshold masks every "
            f"tracked instance. Set transient.lr to {1 / max(trained, 1):.2g} or more"
        )


class MasksOptions(ThresholdOptions):
    """Selection of transient instances, by the network's mean probability over all their pixels. Masks that are merged in 3D stand still; only tracks can be transient."""

    stands_out: Annotated[Share, READING] = 0.35
    """Least share of a transient instance's pixels that stand out from the temporary Gaussians at the end of the
    warm-up: a squared difference of more than 3.5 medians of the frame (docs/method.md#stands-out). It drops static
    things that the network calls transient. 0 asks for none, as in the paper. Larger masks less: where arms are
    always in view, 0.5 masks a quarter of the moving pixels and 0.35 two thirds (docs/method.md#still-arms); in
    others 0.3 to 0.55 work equally well."""

    pixel_probability: Annotated[Share, READING] = 0.5
    """Probability from which a pixel of a transient instance is masked in a frame. It leaves out parts of wrong
    outlines, and frames in which a carried thing lies still. 0 masks the whole instance in every frame, as in the
    paper."""

    sure_probability: Annotated[Share | None, READING] = 0.9
    """Probability from which the network is sure that a pixel moves. Where it is in a large region of at least three
    training frames in a row, and no instance explains the region as static, the region is masked without a track
    (docs/method.md#sure-regions). null masks instances alone, as in the paper."""

    max_share: Annotated[float, Field(le=1, gt=0), READING] = 0.5
    """Share above which nothing is masked, and an alarm says why: mean probability of the network over the training
    frames, or share of the instances that would be transient; poses, exposure or blur are rather mistaken for motion.
    1 never withholds masks, as in the paper."""
