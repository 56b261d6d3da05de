"""Schema of ``splats.zarr``: trained Gaussians, training curves, and renders of held-out frames."""

from egosplat.artifacts.schema import Field, Schema

SPLATS = Schema(
    "splats",
    2,
    {
        "means": Field(("gaussian", 3), "float32", "m", "centres, in the world of poses.zarr"),
        "quats": Field(("gaussian", 4), "float32", "-", "rotations to the world, wxyz, of any length but 0"),
        "log_scales": Field(
            ("gaussian", 3), "float32", "log m", "natural logarithm of the standard deviations"
        ),
        "logit_opacities": Field(("gaussian",), "float32", "logit", "opacity = 1 / (1 + exp(-logit))"),
        "sh": Field(
            ("gaussian", "coefficient", 3),
            "float32",
            "sRGB 0..1",
            "spherical harmonics of the direction from camera to centre, 3DGS's order; colour = max(sum + 0.5, 0)",
        ),
        "features": Field(
            ("gaussian", "channel"),
            "float32",
            "-",
            "codes of all levels, side by side, where they were trained with the geometry; else no column",
        ),
        "curve/iteration": Field(("record",), "int64", "iteration", "last iteration of each record"),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before"
        ),
        "curve/gaussians": Field(("record",), "int64", "count", "Gaussians after that iteration"),
        "history/iteration": Field(("evaluation",), "int64", "iteration", "when Gaussians were evaluated"),
        "history/psnr": Field(
            ("evaluation",), "float64", "dB", "mean over the held-out frames; NaN without any"
        ),
        "history/ssim": Field(
            ("evaluation",), "float64", "-", "mean over the held-out frames; NaN without any"
        ),
        "history/validation_psnr": Field(
            ("evaluation",), "float64", "dB", "mean over the validation frames; NaN without early stopping"
        ),
        "held_out/frame": Field(("frame",), "int64", "index", "held-out frame's index in frames.zarr"),
        "held_out/psnr": Field(
            ("frame",), "float64", "dB", "of the Gaussians stored here, valid pixels only"
        ),
        "held_out/ssim": Field(("frame",), "float64", "-", "the same; NaN where no whole window is valid"),
        "held_out/render": Field(
            ("frame", "height", "width", 3), "uint8", "sRGB", "the held-out frames, rendered", by_row=True
        ),
    },
)
