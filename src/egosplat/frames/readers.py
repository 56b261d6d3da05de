"""Open a recording by the name of its format."""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.frames.adt import AdtRecording
from egosplat.frames.hoi4d import Hoi4dRecording
from egosplat.frames.plain import PlainRecording
from egosplat.frames.recording import Recording
from egosplat.frames.selection import FIRST

FORMATS = ("adt", "hoi4d", "plain")


def open_recording(
    format: str,
    path: Path,
    *,
    resolution: int,
    focal: float,
    upright: bool,
    stride: int,
    start_s: float,
    end_s: float | None,
    known_poses: str = "auto",
    lens: str = "auto",
    pick: str = FIRST,
) -> Recording:
    """Open the frames of a recording.

    Args:
        format: ``adt`` (a sequence folder), ``hoi4d`` (a sequence folder or name) or ``plain`` (a video
            file or image folder).
        resolution: size of the frames [px]: side (adt), width (hoi4d), longer side (plain).
        focal: adt only: focal length [px] of rectified frames of 1408 px.
        upright: adt only: whether frames are turned upright.
        stride: take every ``stride``-th frame.
        start_s, end_s: take frames with start <= t < end, in seconds after the first frame; None: to the end.
        known_poses: plain only: which of its files with known poses calibrates the frames.
        lens: plain only: whether frames without a calibration are rectified from an estimated lens.
        pick: ``sharpest``, plain only: take the sharpest of every ``stride`` frames instead of the first.

    Raises:
        UserError: the format is unknown, the recording unreadable, or an option out of range.
    """
    selection = {"resolution": resolution, "stride": stride, "start_s": start_s, "end_s": end_s}
    if pick != FIRST and format != "plain":
        raise UserError(f"frames.pick={pick}: only for plain recordings, and this is {format}; set first.")
    match format:
        case "adt":
            return AdtRecording(path, focal=focal, upright=upright, **selection)
        case "hoi4d":
            return Hoi4dRecording(path, **selection)
        case "plain":
            return PlainRecording(path, known_poses=known_poses, lens=lens, pick=pick, **selection)
    raise UserError(f"format: {format!r} is unknown; choose from {', '.join(FORMATS)}.")
