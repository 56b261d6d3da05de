"""Alarms of the stages that read a recording: frames and poses."""

from collections.abc import Iterator, Sequence

from egosplat.alarms.alarm import Alarm, exceeds, falls_below

# The lens circle leaves 0.70 to 0.80 of a rectified Aria image; other recordings have no border.
# Share of an image that shows the scene.
MIN_VALID_PIXELS = 0.5

# A synthetic apartment and two series of photographs have none. COLMAP does not register such frames; one
# in ten leaves gaps in a trajectory.
# Share of the frames that are far less sharp than the recording's median (egosplat.frames.stage).
MAX_BLURRED = 0.1

# COLMAP finds all in five synthetic apartments (benchmarks/colmap/README.md) and in two series of
# photographs; a device's trajectory has all.
# Share of the frames with a pose.
MIN_REGISTERED = 0.9

# It is 0.25 to 0.30 in synthetic apartments and 0.35 to 0.81 in photographs. Features are located to a
# fraction of a pixel: an error above 1 px means wrong matches.
# Mean reprojection error over the observations of COLMAP's points [px].
MAX_REPROJECTION_PX = 1.0

# COLMAP drops points that are seen under a smaller angle: their depth is unknown.
# Angle under which the median point sees the known poses [deg].
MIN_PARALLAX_DEG = 1.5


def frames_alarms(valid_pixels: float | None, blurred: float | None) -> Iterator[Alarm]:
    """Alarms of the frames artifact.

    Args:
        valid_pixels: share of an image that shows the scene.
        blurred: share of the frames that are blurred or blank.
    """
    if falls_below(valid_pixels, MIN_VALID_PIXELS):
        yield Alarm(
            "frames.valid_pixels",
            f"{MIN_VALID_PIXELS:.0%} or more",
            f"{valid_pixels:.1%} of an image's pixels show the scene",
            "Check contact_sheet.png. Raise frames.focal, which crops the border",
        )
    if exceeds(blurred, MAX_BLURRED):
        yield Alarm(
            "frames.blurred",
            f"up to {MAX_BLURRED:.0%}",
            f"{blurred:.1%} of the frames are blurred or blank, compared with the others",
            "Training gains little from them, and they may get no pose. Exclude them (frames.start_s, end_s), or move the camera slower",
        )


def poses_alarms(
    registered: float | None,
    reprojection_px: float | None,
    models: Sequence[int],
    parallax_deg: float | None = None,
) -> Iterator[Alarm]:
    """Alarms of the poses artifact.

    Args:
        registered: share of the frames with a pose.
        reprojection_px: mean reprojection error of COLMAP's points [px]; None without COLMAP.
        models: number of frames in each of COLMAP's models, the largest first; empty without COLMAP.
        parallax_deg: angle under which the median point sees the known poses; None if they are not known or it has
            no points. COLMAP itself rejects a still camera.
    """
    if falls_below(registered, MIN_REGISTERED):
        yield Alarm(
            "poses.registered",
            f"{MIN_REGISTERED:.0%} or more",
            f"{registered:.1%} of the frames have a pose",
            "The others are not used; the log of poses lists them. Record sharper frames, or reduce frames.stride",
        )
    if exceeds(reprojection_px, MAX_REPROJECTION_PX):
        yield Alarm(
            "poses.reprojection",
            f"up to {MAX_REPROJECTION_PX:g} px",
            f"the mean reprojection error is {reprojection_px:.2f} px",
            "The poses are inexact. Check the calibration, rolling shutter and motion blur",
        )
    if falls_below(parallax_deg, MIN_PARALLAX_DEG):
        yield Alarm(
            "poses.parallax",
            f"{MIN_PARALLAX_DEG:g}° or more",
            f"the median point sees all cameras within {parallax_deg:.2g}°: the camera stands still",
            "No depth follows from such poses. Move the camera",
        )
    if len(models) > 1:
        yield Alarm(
            "poses.models",
            "1 model",
            f"COLMAP finds {len(models)} unconnected models of {', '.join(map(str, models))} frames",
            "Only the largest is used; the log of poses says which frames and why. Record the ways between the parts, or make each part a separate scene",
        )
