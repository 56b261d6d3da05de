"""Options of the stages ``transient`` and ``masks``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import READING, Count, Options, Positive, Share, Text
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


class RecipeOptions(Options, section="transient"):
    """Recipe of the network, and of the masks that follow from it."""

    recipe: Annotated[Literal["own", "paper"], READING] = "own"
    """How the network and the temporary Gaussians are trained (docs/method.md#temporary-gaussians), and what is masked
    (docs/method.md#stands-out). own: the unit of transient_penalty is the median squared difference of a frame to the
    Gaussians at the end of the warm-up, or the median of that over the frames if that is larger: it follows the
    camera's noise, blur, exposure and poses. The Gaussians are few, of one color each, on black, by a schedule that is
    scaled to the run; the network predicts by the statistics of the frame itself; masks leave out what looks static,
    add regions that the network is sure of, and are withheld where most would move. paper: the unit
    is the squared sRGB difference in 0..1, summed over R, G and B; the rest is as in EgoLifter, with 3DGS's schedule,
    cut off at the end of the run, and running averages; whole instances are masked."""


class TransientOptions(RecipeOptions, CameraOptions, SeedOptions, BackendOptions, NearPlaneOptions):
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

    # The encoder halves five times. Of 32 px a single one would be left, on which batch norm cannot train.
    input_size: Annotated[int, Field(ge=64, multiple_of=32)] = 96
    """Side in pixels of the square network input, a multiple of 32. EgoLifter uses 224. Small moving objects need a
    larger input; the network's time grows with its square."""

    encoder_weights: Text | None = None
    """Encoder weights of timm's mobilenetv3_small_050: published (EgoLifter's, from ImageNet, in the folder
    models.cache) or a .pt, .bin or .safetensors file. null starts from random weights."""

    def stays_at_start(self) -> str | None:
        """Say that the network will call static pixels transient, and what to set; None if it is trained long enough."""
        trained = self.iterations - round(self.warmup * self.iterations)
        if self.lr * trained >= LEAST_REACH:
            return None
        return (
            f"transient.lr {self.lr:g} x {trained} iterations = {self.lr * trained:.2g}. Below {LEAST_REACH} the network "
            "stays near its start: static pixels keep a probability of up to 0.5, and a lower masks.threshold masks every "
            f"tracked instance. {f'Set transient.lr to {1 / trained:.2g} or more' if trained else 'Lower transient.warmup'}"
        )


class MasksOptions(RecipeOptions, ThresholdOptions):
    """Selection of transient instances, by the network's mean probability over all their pixels. Masks that are merged in 3D stand still; only tracks can be transient."""
