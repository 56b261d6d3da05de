"""Read the vertices of a PLY file: all columns, or positions and colors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError

# Types by their names in C; the header may also have numpy's names.
_TYPES = {"char": "i1", "short": "i2", "int": "i4", "float": "f4"}
_TYPES |= {"uchar": "u1", "ushort": "u2", "uint": "u4", "double": "f8"}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = b"end_header"
# Color of points without one.
_GREY = 128
# What damaged content raises.
_DAMAGE = (OSError, ValueError, KeyError, IndexError, TypeError)


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(P, 3) float64 positions and (P, 3) uint8 colors, gray if the file has none; UserError as ``read_vertices``."""
    vertices = read_vertices(path)
    try:
        points = np.stack([vertices[axis] for axis in "xyz"], axis=-1).astype(np.float64)
        colors = np.full(points.shape, _GREY, np.uint8)
        if {"red", "green", "blue"} <= set(vertices.dtype.names):
            colors = _in_bytes(np.stack([vertices[name] for name in ("red", "green", "blue")], axis=-1))
    except _DAMAGE as error:
        raise _unreadable(path, error) from error
    return points, colors


def read_vertices(path: Path) -> NDArray[np.void]:
    """The table of vertices of a PLY file, by the header's columns; UserError if it is damaged or they are not first."""
    try:
        return _vertices(path.read_bytes())
    except _DAMAGE as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> UserError:
    return UserError(f"{path}: not a readable PLY file of points ({str(error)[:100]}).")


def _in_bytes(colors: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Colors of another type as 0 to 255: fractions, or numbers up to the largest of their type."""
    if colors.dtype == np.uint8:
        return colors
    most = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return np.rint(np.nan_to_num(colors / most).clip(0, 1) * 255).astype(np.uint8)


def _vertices(content: bytes) -> NDArray[np.void]:
    """The table of vertices, with the columns that the header names."""
    head, found, body = content.partition(_END)
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    if not found or lines[0] != ["ply"]:
        raise ValueError("no header")
    body = body.partition(b"\n")[2]
    (order,) = [_ORDERS[words[1]] for words in lines if words and words[0] == "format"]
    elements = [index for index, words in enumerate(lines) if words and words[0] == "element"]
    first = lines[elements[0]]
    if first[1] != "vertex":
        raise ValueError(f"its first element is {first[1]}")
    columns = lines[elements[0] + 1 : elements[1] if len(elements) > 1 else None]
    columns = [words for words in columns if words and words[0] == "property"]
    table = np.dtype(
        [(words[2], np.dtype(_TYPES.get(words[1], words[1])).newbyteorder(order)) for words in columns]
    )
    count = int(first[2])
    if order != "=":
        return np.frombuffer(body, table, count)
    rows = body.decode("ascii").splitlines()[:count]
    if len(rows) < count:
        raise ValueError(f"{len(rows)} of {count} points")
    return np.array([tuple(map(float, row.split())) for row in rows], dtype=table).reshape(-1)
