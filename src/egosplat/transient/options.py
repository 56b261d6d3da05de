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
    """Loss of a pixel that the network calls transient, in the unit of penalty_unit; it does so if the residual is
    larger. Larger masks less. The paper prints 0.2 and EgoLifter uses 0.01, both absolute
    (docs/method.md#transient-loss). Median residuals are 0.9 to 1.0 units of static pixels, 3 to 12 of moving ones."""

    penalty_unit: Annotated[Literal["residual", "absolute"], READING] = "residual"
    """Unit of transient_penalty (docs/method.md#residual-unit). residual: the median squared difference of a frame
    to the temporary Gaussians at the end of the warm-up, or the median of that over the frames if that is larger;
    it follows the camera's noise, blur, exposure and poses. absolute: squared sRGB difference in 0..1, as in the
    paper; masks.stands_out has no effect then."""

    residual: Annotated[Literal["mean", "sum"], READING] = "mean"
    """Squared difference over R, G and B. mean: as in EgoLifter's code. sum: as in the paper's formula, equivalent
    to a third of transient_penalty."""

    lr: Annotated[Positive, READING] = 0.001
    """Adam learning rate of the network. A weight moves by about as much an iteration: with the paper's 1e-5 and
    7,000 iterations by 0.07, which left all pixels near 0.5. The stage and egosplat doctor say so below 0.7."""

    input_size: Annotated[int, Field(ge=64, multiple_of=32)] = 96
    """Side in pixels of the square network input, a multiple of 32. EgoLifter uses 224. Small moving objects need a
    larger input; the network's time grows with its square."""

    encoder_weights: Text | None = None
    """Encoder weights of timm's mobilenetv3_small_050: published (EgoLifter's, from ImageNet, in the folder
    models.cache) or a .pt, .bin or .safetensors file. null starts from random weights."""

    batch_norm: Annotated[Literal["train", "eval"], READING] = "train"
    """Batch statistics of the trained network (docs/method.md#batch-norm). train: of the frame itself, as in
    training. eval: running averages, as in EgoLifter, which were worse after 2,000 iterations."""

    schedule: Annotated[Literal["scaled", "cut"], READING] = "scaled"
    """Schedule of learning rate and density control in a run shorter than 3DGS's 30,000 iterations
    (docs/method.md#temporary-schedule). scaled: scaled to the run. cut: cut off at its end, as in EgoLifter; then
    Gaussians grow until the end, and the opacity reset after 3,000 iterations undoes part of the training."""

    max_points: Annotated[Count, READING] = 20000
    """Largest number of initial points of the temporary Gaussians, as splats.max_points."""

    densify_init: Annotated[bool, READING] = True
    """Initial points where the tracker found none, as splats.densify_init, for the temporary Gaussians. Without it
    windows and lamps are reconstructed so late that the network marks them as transient."""

    max_gaussians: Annotated[Count, READING] = 60000
    """Largest number of temporary Gaussians. More reconstruct more of the static scene, and more of the moving
    objects too."""

    grow_grad2d: Annotated[Positive, READING] = 2e-05
    """Densification threshold of the temporary Gaussians; smaller makes more. Gradients of squared differences are
    about ten times smaller than those that 3DGS's 0.0002 is chosen for. With it, static surfaces without points
    (windows, lamps) are never reconstructed and are marked as transient."""

    reset_opacity: Annotated[float, Field(gt=0.005, lt=1), READING] = 0.05
    """Opacity after a reset, as splats.reset_opacity, for the temporary Gaussians."""

    reset_at_start: Annotated[bool, READING] = False
    """Reset opacities at the start, as splats.reset_at_start, for the temporary Gaussians."""

    prune_screen_px: Annotated[Positive | None, READING] = None
    """Largest screen radius, as splats.prune_screen_px, for the temporary Gaussians."""

    sh_degree: Annotated[int, Field(ge=0, le=3), READING] = 0
    """Highest spherical-harmonics degree of the temporary Gaussians. View-dependent color can fit moving objects; 0
    leaves them to the network, and highlights too. The paper's setting is 3."""

    background: Annotated[Literal["black", "white", "random"], READING] = "black"
    """Color behind the temporary Gaussians, as splats.background. EgoLifter uses white."""

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

    level: Annotated[Literal["subpart", "part", "whole", "all"], READING] = "all"
    """Level whose instances may be transient, or all for their union (docs/method.md#mask-level). Smaller ones follow
    what moves more closely; one wrong instance of the level whole masks a large area."""
