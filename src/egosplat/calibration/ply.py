"""Read the vertices of a PLY file: all columns, or positions and colors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError, reraise_as
from egosplat.progress import log

# numpy's types by the names of C, beside its own names, and orders of bytes.
_TYPES = {"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"}
_TYPES |= {"uchar": "u1", "ushort": "u2", "uint": "u4"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
# Color of points without one, largest number of a color, and names of colors, in small letters: usual, of MeshLab, and of PCL.
_GREY, _MOST = 128, 2.0**32
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(P, 3) float64 positions and (P, 3) uint8 colors, gray if the file has none; UserError as ``read_vertices``."""
    vertices = read_vertices(path)
    names = {*(vertices.dtype.names or ())}
    if not {*"xyz"} <= names:
        raise UserError(f"{path}: not a readable PLY file of points (no x, y, z).")
    points = np.stack([vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    own = {name.lower(): vertices[name] for name in names}
    if (found := next((each for each in _COLORS if {*each} <= own.keys()), None)) is None:
        log(f"{path}: its points have no {', '.join(_COLORS[0])}, and are gray")
        return points, np.full(points.shape, _GREY, np.uint8)
    colors = np.stack([own[name].astype(np.float64) for name in found], axis=-1)
    wrong = ~(np.abs(colors) <= _MOST).all(axis=1)
    if wrong.any():
        log(
            f"{path}: {wrong.sum()} of its points have colors that are no numbers or above {_MOST:g}, and are gray"
        )
    colors[wrong] = 0.0
    # Fractions, or numbers of up to 8, 16 or 32 bits.
    least = 1.0 if own[found[0]].dtype.kind == "f" else 255.0
    most = next((most for most in (least, 255.0, 65535.0) if colors.max(initial=0) <= most), _MOST)
    return points, np.where(wrong[:, None], _GREY, (colors / most).clip(0, 1) * 255).round().astype(np.uint8)


def read_vertices(path: Path) -> NDArray[np.void]:
    """The table of vertices of a PLY file, by the header's columns; UserError if it is damaged or they are not first."""
    with reraise_as(
        lambda error: UserError(f"{path}: not a readable PLY file of points ({str(error)[:100]})."),
        (OSError, ValueError, KeyError, IndexError, TypeError, OverflowError),
    ):
        head, end, body = path.read_bytes().partition(b"\nend_header")
        # Comments have any letters.
        lines = [words for line in head.decode(errors="replace").splitlines() if (words := line.split())]
        if not end or lines[0] != ["ply"]:
            raise ValueError("no header")
        (order,) = [_ORDERS[words[1]] for words in lines if words[0] == "format"]
        first, *others = [index for index, words in enumerate(lines) if words[0] == "element"]
        _, element, count = lines[first]
        if element != "vertex" or int(count) < 0:
            raise ValueError(f"its first element is {element} {count}")
        columns = [words for words in lines[first : others[0] if others else None] if words[0] == "property"]
        table = np.dtype([(name, _TYPES.get(kind, kind)) for _, kind, name in columns]).newbyteorder(order)
        body = body.partition(b"\n")[2]
        if order != "=":
            return np.frombuffer(body, table, int(count))
        rows = [tuple(map(float, row.split())) for row in body.decode("ascii").splitlines()[: int(count)]]
        if len(rows) < int(count):
            raise ValueError(f"{len(rows)} of {count} points")
        return np.array(rows, dtype=table).reshape(-1)
