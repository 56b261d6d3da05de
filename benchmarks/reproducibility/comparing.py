"""The differences between two versions of an artifact."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import open_any
from egosplat.artifacts.schemas import SCHEMAS

# Parts of documents that differ each time.
VOLATILE = {"provenance", "artifacts", "costs", "created", "wall_s", "cpu_s", "peak_memory_mb", "digest"}


@dataclass(frozen=True)
class Difference:
    """One array, file or value that differs.

    Attributes:
        name: of it.
        share: of its values that differ; 1 where the shapes differ.
        largest: difference of numbers, as a share of the largest number; None of labels, files and words.
    """

    name: str
    share: float
    largest: float | None


def differences(one: Path, other: Path) -> list[Difference]:
    """The differences of two artifacts, documents or recordings; empty if all their values are equal."""
    if one.suffix == ".zarr":
        return _of_artifacts(one, other)
    if one.suffix == ".json":
        return _of_documents(one, other)
    return _of_folders(one, other)


def _of_artifacts(one: Path, other: Path) -> list[Difference]:
    first, second = open_any(one, SCHEMAS), open_any(other, SCHEMAS)
    if first.digest == second.digest:
        return []
    both = set(first.arrays) & set(second.arrays)
    alone = [Difference(f"{name} in one only", 1.0, None) for name in {*first.arrays, *second.arrays} - both]
    pairs = ((name, first.read(name), second.read(name)) for name in first.arrays if name in both)
    return [*alone, *(found for name, a, b in pairs if (found := _of_arrays(name, a, b)))]


def _of_arrays(name: str, one: NDArray[Any], other: NDArray[Any]) -> Difference | None:
    if one.shape != other.shape:
        return Difference(f"{name} {one.shape} against {other.shape}", 1.0, None)
    numbers = one.dtype.kind == "f"
    unequal = (one != other) & ~(np.isnan(one) & np.isnan(other)) if numbers else one != other
    if not unequal.any():
        return None
    if not numbers and one.dtype != np.uint8:
        return Difference(name, float(unequal.mean()), None)
    a, b = one[unequal].astype(np.float64), other[unequal].astype(np.float64)
    largest = np.nanmax(np.abs(a - b)) / max(float(np.nanmax(np.abs(one.astype(np.float64)))), 1e-300)
    return Difference(name, float(unequal.mean()), float(largest))


def _of_documents(one: Path, other: Path) -> list[Difference]:
    first, second = (dict(_leaves("", json.loads(path.read_text()))) for path in (one, other))
    if first.keys() != second.keys():
        return [Difference("what is listed", 1.0, None)]
    found = []
    for name, a in first.items():
        b = second[name]
        if a == b:
            continue
        numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (a, b))
        largest = abs(a - b) / max(abs(a), abs(b)) if numbers else None
        found.append(Difference(name, 1 / len(first), largest))
    return found


def _leaves(name: str, value: Any):
    """Names and values of a document's single values, without what differs each time."""
    if isinstance(value, dict):
        for key, part in value.items():
            if key not in VOLATILE:
                yield from _leaves(f"{name}.{key}".lstrip("."), part)
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _leaves(f"{name}[{number}]", part)
    else:
        yield name, value


def _of_folders(one: Path, other: Path) -> list[Difference]:
    first, second = {}, {}
    for root, hashes in ((one, first), (other, second)):
        for path in filter(Path.is_file, root.rglob("*")):
            hashes[str(path.relative_to(root))] = hashlib.sha256(path.read_bytes()).digest()
    names = sorted(first | second)
    return [Difference(name, 1.0, None) for name in names if first.get(name) != second.get(name)]
