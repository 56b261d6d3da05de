"""Read the vertices of a PLY file: all columns, or positions and colors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError, reraise_as

# Types by their names in C; the header may also have numpy's names.
_TYPES = {"char": "i1", "short": "i2", "int": "i4", "float": "f4"}
_TYPES |= {"uchar": "u1", "ushort": "u2", "uint": "u4", "double": "f8"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLORS = ["red", "green", "blue"]
# Color of points without one.
_GREY = 128


def _checked(path: Path):
    """Turn what damaged content raises into a UserError."""
    return reraise_as(
        lambda error: UserError(f"{path}: not a readable PLY file of points ({str(error)[:100]})."),
        (OSError, ValueError, KeyError, IndexError, TypeError),
    )


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(P, 3) float64 positions and (P, 3) uint8 colors, gray if the file has none; UserError as ``read_vertices``."""
    vertices = read_vertices(path)
    with _checked(path):
        points = np.stack([vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)
        if not {*_COLORS} <= set(vertices.dtype.names or ()):
            return points, np.full(points.shape, _GREY, np.uint8)
        colors = np.stack([vertices[name] for name in _COLORS], axis=-1)
        if colors.dtype == np.uint8:
            return points, colors
        # Fractions, or numbers up to the largest of their type.
        most = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
        return points, np.rint(np.nan_to_num(colors / most).clip(0, 1) * 255).astype(np.uint8)


def read_vertices(path: Path) -> NDArray[np.void]:
    """The table of vertices of a PLY file, by the header's columns; UserError if it is damaged or they are not first."""
    with _checked(path):
        head, end, body = path.read_bytes().partition(b"end_header")
        lines = [words for line in head.decode("ascii").splitlines() if (words := line.split())]
        if not end or lines[0] != ["ply"]:
            raise ValueError("no header")
        body = body.partition(b"\n")[2]
        (order,) = [_ORDERS[words[1]] for words in lines if words[0] == "format"]
        first, *others = [index for index, words in enumerate(lines) if words[0] == "element"]
        _, element, count = lines[first]
        if element != "vertex":
            raise ValueError(f"its first element is {element}")
        columns = lines[first + 1 : others[0] if others else None]
        table = np.dtype(
            [
                (words[2], np.dtype(_TYPES.get(words[1], words[1])).newbyteorder(order))
                for words in columns
                if words[0] == "property"
            ]
        )
        if order != "=":
            return np.frombuffer(body, table, int(count))
        rows = body.decode("ascii").splitlines()[: int(count)]
        if len(rows) < int(count):
            raise ValueError(f"{len(rows)} of {count} points")
        return np.array([tuple(map(float, row.split())) for row in rows], dtype=table).reshape(-1)
