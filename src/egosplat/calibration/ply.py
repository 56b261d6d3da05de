"""Read the vertices of a PLY file: all columns, or positions and colors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError, reraise_as

# numpy's types by the names of C and of numpy, and orders of bytes.
_TYPES = {"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"}
_TYPES |= {"uchar": "u1", "ushort": "u2", "uint": "u4", "int8": "i1", "int16": "i2", "int32": "i4"}
_TYPES |= {"uint8": "u1", "uint16": "u2", "uint32": "u4", "float32": "f4", "float64": "f8"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
# Color of points without one.
_GREY = 128


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(P, 3) float64 positions and (P, 3) uint8 colors, gray if the file has none; UserError as ``read_vertices``."""
    vertices = read_vertices(path)
    names = {*(vertices.dtype.names or ())}
    if not {*"xyz"} <= names:
        raise UserError(f"{path}: not a readable PLY file of points (no x, y, z).")
    points = np.stack([vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    if not {"red", "green", "blue"} <= names:
        return points, np.full(points.shape, _GREY, np.uint8)
    colors = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=-1)
    if colors.dtype == np.uint8:
        return points, colors
    # Fractions, or numbers up to the largest of their type.
    most = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return points, np.rint(np.nan_to_num(colors / most).clip(0, 1) * 255).astype(np.uint8)


def read_vertices(path: Path) -> NDArray[np.void]:
    """The table of vertices of a PLY file, by the header's columns; UserError if it is damaged or they are not first."""
    with reraise_as(
        lambda error: UserError(f"{path}: not a readable PLY file of points ({str(error)[:100]})."),
        (OSError, ValueError, KeyError, IndexError, TypeError),
    ):
        head, end, body = path.read_bytes().partition(b"end_header")
        lines = [words for line in head.decode("ascii").splitlines() if (words := line.split())]
        if not end or lines[0] != ["ply"]:
            raise ValueError("no header")
        (order,) = [_ORDERS[words[1]] for words in lines if words[0] == "format"]
        first, *others = [index for index, words in enumerate(lines) if words[0] == "element"]
        _, element, count = lines[first]
        if element != "vertex":
            raise ValueError(f"its first element is {element}")
        columns = [words for words in lines[first : others[0] if others else None] if words[0] == "property"]
        table = np.dtype([(name, order + _TYPES[kind]) for _, kind, name in columns])
        body = body.partition(b"\n")[2]
        if order != "=":
            return np.frombuffer(body, table, int(count))
        rows = [tuple(map(float, row.split())) for row in body.decode("ascii").splitlines()[: int(count)]]
        if len(rows) < int(count):
            raise ValueError(f"{len(rows)} of {count} points")
        return np.array(rows, dtype=table).reshape(-1)
