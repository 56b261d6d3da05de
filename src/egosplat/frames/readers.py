"""Open a recording by the name of its format."""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.frames.keys import ReaderKeys
from egosplat.frames.recording import Recording
from egosplat.frames.selection import FIRST
from egosplat.pipeline.stages import load_module


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
        format: ``adt`` (a sequence folder), ``hoi4d`` (a sequence folder or name), ``plain`` (a video file or
            image folder), ``lerf`` or ``3d_ovs`` (a scene's folder).
        resolution: size of the frames [px]: side (adt), width (hoi4d), longer side (pictures).
        focal: adt only: focal length [px] of rectified frames of 1408 px.
        upright: adt only: whether frames are turned upright.
        stride: take every ``stride``-th frame.
        start_s, end_s: take frames with start <= t < end, in seconds after the first frame; None: to the end.
        known_poses: pictures only: which of their files with known poses calibrates the frames.
        lens: pictures only: whether frames without a calibration are rectified from an estimated lens.
        pick: ``sharpest``, plain only: take the sharpest of every ``stride`` frames instead of the first.

    Raises:
        UserError: the format is unknown, the recording unreadable, or an option out of range.
    """
    if pick != FIRST and format != "plain":
        raise UserError(f"frames.pick={pick}: only for plain recordings, and this is {format}; set first.")
    keys = ReaderKeys(resolution, focal, upright, stride, start_s, end_s, known_poses, lens, pick)
    return load_module("frames", format).open_recording(path, keys)
