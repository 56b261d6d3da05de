"""Schema of ``splats.zarr``: trained Gaussians, training curves, and renders of held-out frames."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Field, Schema
from egosplat.artifacts.values import (
    ANY,
    COUNT,
    FINITE_OR_UNKNOWN,
    POSES_OR_UNKNOWN,
    SCALE_OR_UNKNOWN,
    Values,
)

# Values of ``corrections/source``.
AS_GIVEN, TRAINED, FITTED, INTERPOLATED = range(4)

SPLATS = Schema(
    "splats",
    2,
    {
        "means": Field(("gaussian", 3), "float32", "m", "centers, in the world of poses.zarr"),
        "quats": Field(("gaussian", 4), "float32", "-", "rotations to the world, wxyz, of any length but 0"),
        "log_scales": Field(
            ("gaussian", 3), "float32", "log m", "natural logarithm of the standard deviations"
        ),
        "logit_opacities": Field(("gaussian",), "float32", "logit", "opacity = 1 / (1 + exp(-logit))"),
        "sh": Field(
            ("gaussian", "coefficient", 3),
            "float32",
            "sRGB 0..1",
            "spherical harmonics of the direction from camera to center, 3DGS's order; color = max(sum + 0.5, 0)",
        ),
        "features": Field(
            ("gaussian", "channel"),
            "float32",
            "-",
            "codes of all levels, side by side, where they were trained with the geometry; else no column",
        ),
        "curve/iteration": Field(
            ("record",), "int64", "iteration", "last iteration of each record", values=COUNT
        ),
        "curve/loss": Field(
            ("record",), "float64", "-", "mean loss of the iterations since the record before", values=ANY
        ),
        "curve/gaussians": Field(
            ("record",), "int64", "count", "Gaussians after that iteration", values=COUNT
        ),
        "history/iteration": Field(
            ("evaluation",), "int64", "iteration", "when Gaussians were evaluated", values=COUNT
        ),
        "history/psnr": Field(
            ("evaluation",), "float64", "dB", "mean over the held-out frames; NaN without any", values=ANY
        ),
        "history/ssim": Field(
            ("evaluation",),
            "float64",
            "-",
            "mean over the held-out frames; NaN without any",
            values=FINITE_OR_UNKNOWN,
        ),
        "held_out/frame": Field(
            ("frame",), "int64", "index", "held-out frame's index in frames.zarr", values=COUNT
        ),
        "held_out/psnr": Field(
            ("frame",), "float64", "dB", "of the Gaussians stored here, valid pixels only", values=ANY
        ),
        "held_out/ssim": Field(
            ("frame",),
            "float64",
            "-",
            "the same; NaN where no whole window is valid",
            values=FINITE_OR_UNKNOWN,
        ),
        "held_out/render": Field(
            ("frame", "height", "width", 3), "uint8", "sRGB", "the held-out frames, rendered", by_row=True
        ),
        # Only where poses or exposures are corrected. The scores and renders above are those after correction.
        "held_out/psnr_given": Field(
            ("frame",), "float64", "dB", "with the poses of poses.zarr and no gain", optional=True, values=ANY
        ),
        "held_out/ssim_given": Field(
            ("frame",), "float64", "-", "the same", optional=True, values=FINITE_OR_UNKNOWN
        ),
        "held_out/render_given": Field(
            ("frame", "height", "width", 3), "uint8", "sRGB", "the same", by_row=True, optional=True
        ),
        "corrections/camera_to_world": Field(
            ("recorded_frame", 4, 4),
            "float64",
            "m",
            "poses of all frames after correction, OpenCV axes; NaN where not registered",
            optional=True,
            values=POSES_OR_UNKNOWN,
        ),
        "corrections/source": Field(
            ("recorded_frame",),
            "int8",
            "-",
            "0 as in poses.zarr, 1 trained, 2 held out and fitted afterwards, 3 between frames that were trained",
            optional=True,
            values=Values(least=AS_GIVEN, most=INTERPOLATED),
        ),
        "corrections/shift": Field(
            ("recorded_frame", 3),
            "float64",
            "m",
            "from the camera's center in poses.zarr to that after correction, in the world",
            optional=True,
            values=FINITE_OR_UNKNOWN,
        ),
        "corrections/turn": Field(
            ("recorded_frame",),
            "float64",
            "deg",
            "angle between the orientations before and after",
            optional=True,
            values=SCALE_OR_UNKNOWN,
        ),
        "corrections/gain": Field(
            ("recorded_frame", 3),
            "float64",
            "-",
            "factor of red, green and blue from the Gaussians' render to the frame",
            optional=True,
            values=SCALE_OR_UNKNOWN,
        ),
    },
)


def camera_poses(poses: Artifact, splats: Artifact) -> NDArray[np.float64]:
    """(F, 4, 4) float64 poses to render with, those of training where it refined them; NaN where not registered."""
    corrected = splats.has("corrections/camera_to_world")
    return splats.read("corrections/camera_to_world") if corrected else poses.read("camera_to_world")
