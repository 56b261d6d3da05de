"""Read ``camera.json``, the calibration of a plain recording."""

from pathlib import Path

from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.files import read_json

_KEYS = ("width", "height", "fx", "fy", "cx", "cy")
# OpenCV's first four; a file without them is of pictures without distortion.
_DISTORTION = ("k1", "k2", "p1", "p2")


def read_camera_file(path: Path, width: int, height: int) -> Lens:
    """Read the calibration of pictures of ``width`` x ``height`` pixels.

    Raises:
        UserError: the file is damaged, for pictures of another size, or not possible.
    """
    try:
        entries = read_json(path)
        numbers = [float(entries[key]) for key in _KEYS]
        distortion = [float(entries.get(key, 0.0)) for key in _DISTORTION]
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: not an object with the numbers {', '.join(_KEYS)} ({repr(error)[:200]})."
        ) from error
    if (numbers[0], numbers[1]) != (width, height):
        raise UserError(f"{path}: for {numbers[0]:g}x{numbers[1]:g} px, but the frames are {width}x{height}.")
    return Lens("OPENCV", width, height, (*numbers[2:], *distortion)).check(str(path))
