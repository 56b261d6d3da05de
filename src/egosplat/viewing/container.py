"""Pack named arrays and facts into text for a script element; ``source/container.js`` reads it."""

import base64
import gzip
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

Arrays = dict[str, np.ndarray]
Facts = dict[str, Any]

# The kinds of numbers that the page reads.
DTYPES = ("uint8", "int8", "uint16", "float16", "float32")


def pack(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    """Pack facts and arrays: gzip in base64, which holds no character that HTML would read as markup.

    Behind the length of the header (uint32) and the header (JSON: facts, and dtype and shape of each array) lie the arrays in order.
    The first bytes of all numbers come before the second bytes: equal bytes in a row compress better.
    """
    for name, values in arrays.items():
        if values.dtype.name not in DTYPES:
            raise ValueError(f"array {name} has dtype {values.dtype}, the page reads {', '.join(DTYPES)}")
    described = {name: {"dtype": values.dtype.name, "shape": values.shape} for name, values in arrays.items()}
    header = json.dumps({"facts": facts, "arrays": described}, allow_nan=False).encode()
    parts = [np.uint32(len(header)).tobytes(), header, *map(_planes, arrays.values())]
    # Without the time of compression: the same scene gives the same page.
    return base64.b64encode(gzip.compress(b"".join(parts), 9, mtime=0)).decode()


def unpack(text: str) -> tuple[Facts, Arrays]:
    """Read what ``pack`` wrote."""
    raw = gzip.decompress(base64.b64decode(text))
    length = int(np.frombuffer(raw, np.uint32, 1)[0])
    header, place = json.loads(raw[4 : 4 + length]), 4 + length
    arrays: Arrays = {}
    for name, about in header["arrays"].items():
        dtype, size = np.dtype(about["dtype"]), int(np.prod(about["shape"]))
        planes = np.frombuffer(raw, np.uint8, size * dtype.itemsize, place).reshape(dtype.itemsize, size)
        arrays[name] = np.ascontiguousarray(planes.T).view(dtype).reshape(about["shape"])
        place += size * dtype.itemsize
    return header["facts"], arrays


def _planes(values: np.ndarray) -> bytes:
    little = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False)
    return little.reshape(-1).view(np.uint8).reshape(-1, values.dtype.itemsize).T.tobytes()
