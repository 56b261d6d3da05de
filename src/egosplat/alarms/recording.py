"""Alarms of the stages that read a recording: frames and poses."""

from collections.abc import Iterator, Sequence

from egosplat.alarms.alarm import Alarm, exceeds, falls_below

MIN_VALID_PIXELS = 0.5
"""Share of a picture that shows the scene. The lens circle leaves 0.70 to 0.80 of a rectified Aria picture, and other
recordings have no border."""

MAX_BLURRED = 0.1
"""Share of the frames that are far less sharp than the recording's median (egosplat.frames.sharpness). There is none in a
synthetic apartment and two series of photographs; COLMAP loses such frames, and every tenth leaves gaps in a walk."""

MIN_REGISTERED = 0.9
"""Share of the frames with a pose. All have one in five synthetic apartments by COLMAP
(benchmarks/colmap/README.md), in two series of photographs and with a device's trajectory."""

MAX_REPROJECTION_PX = 1.0
"""Mean over the observations of COLMAP's points [px]. It is 0.25 to 0.30 in synthetic apartments and 0.35 to 0.81 in
photographs; features are located to a fraction of a pixel, so more than one means wrong matches."""


def frames_alarms(valid_pixels: float | None, blurred: float | None) -> Iterator[Alarm]:
    """Alarms of pictures.

    Args:
        valid_pixels: share of a picture that shows the scene.
        blurred: share of the pictures that are blurred or blank.
    """
    if falls_below(valid_pixels, MIN_VALID_PIXELS):
        yield Alarm(
            "frames.valid_pixels",
            f"{MIN_VALID_PIXELS:.0%} or more",
            f"{valid_pixels:.1%} of a picture's pixels show the scene",
            "Look at contact_sheet.png; raise frames.focal, which shows less of the border",
        )
    if exceeds(blurred, MAX_BLURRED):
        yield Alarm(
            "frames.blurred",
            f"up to {MAX_BLURRED:.0%}",
            f"{blurred:.1%} of the frames are blurred or blank, against the others",
            "They teach little, and may get no pose: leave them out (frames.start_s, end_s), or move the camera slower",
        )


def poses_alarms(
    registered: float | None, reprojection_px: float | None, models: Sequence[int]
) -> Iterator[Alarm]:
    """Alarms of camera poses.

    Args:
        registered: share of the frames with a pose.
        reprojection_px: mean reprojection error of COLMAP's points [px]; None without COLMAP.
        models: frames in each of COLMAP's models, the largest first; none without COLMAP.
    """
    if falls_below(registered, MIN_REGISTERED):
        yield Alarm(
            "poses.registered",
            f"{MIN_REGISTERED:.0%} or more",
            f"{registered:.1%} of the frames have a pose",
            "The others are left out of everything; take sharper frames, or a smaller frames.stride",
        )
    if exceeds(reprojection_px, MAX_REPROJECTION_PX):
        yield Alarm(
            "poses.reprojection",
            f"up to {MAX_REPROJECTION_PX:g} px",
            f"points are reprojected {reprojection_px:.2f} px off",
            "Poses are inexact: check the calibration, rolling shutter and motion blur",
        )
    if len(models) > 1:
        yield Alarm(
            "poses.models",
            "1 model",
            f"COLMAP finds {len(models)} models that share nothing, of {', '.join(map(str, models))} frames",
            "Only the largest is used; film the ways between the parts, or make each part a scene of its own",
        )
