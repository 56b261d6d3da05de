"""Small scenes of artifacts for tests, written by the writer that the stages use."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.artifacts.provenance import Provenance, begin
from egosplat.artifacts.reader import recorded_digest
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.artifacts.writer import create
from egosplat.geometry import Camera

LEVELS = ["part", "whole"]
UP = np.array([0.0, -1.0, 0.0])
_ONES = {"valid", "train", "registered", "annotated", "inlier", "area"}
_ONES |= {"instances/predicted_iou", "instances/stability"}
_TIMES = {"timestamp_ns", "exposure_middle_ns"}
FRAME_STEP_NS = 100_000_000


def sideways(x: np.ndarray) -> np.ndarray:
    """(F, 4, 4) poses of cameras that look ahead, each so far to the right of the origin [m]."""
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    poses[:, 0, 3] = x
    return poses


def camera_facts(camera: Camera, **more: Any) -> dict[str, Any]:
    """Facts of frames.zarr and poses.zarr of a plain recording."""
    about = {"recording": "a recording", "format": "plain", "upright": True, "notes": {}}
    return about | {"camera": asdict(camera)} | more


def put(
    folder: Path,
    name: str,
    arrays: Mapping[str, np.ndarray] | None = None,
    facts: dict[str, Any] | None = None,
    *,
    made_from: Iterable[str] = (),
    size: int = 0,
    made: Provenance | None = None,
    **provenance: Any,
) -> Path:
    """Write ``folder/name.zarr`` with the given arrays; the other arrays that its schema requires get plausible values. ``arrays``:
    arrays by name; a name that is not in the schema is an error. ``facts``: facts of the artifact. ``made_from``: names of artifacts in
    the folder, whose digests are recorded as inputs. ``size``: size of the axes that no given array has. ``made``: the whole
    provenance, instead of the next arguments. ``provenance``: options, origin (by default synthetic), inputs, models; stage (by default
    the artifact's name)."""
    arrays, schema = dict(arrays or {}), SCHEMAS[name]
    if name == "frames" and "train" in arrays:
        arrays.setdefault("evaluation", ~arrays["train"])
    sizes: dict[str | int, int] = {}
    for key, values in arrays.items():
        sizes |= dict(zip(schema.fields[key].dims, values.shape, strict=True))
    path = folder / f"{name}.zarr"
    with create(path, schema, made or _provenance(folder, name, made_from, **provenance)) as artifact:
        for key, field in schema.fields.items():
            if field.optional and key not in arrays:
                continue
            shape = tuple(dim if isinstance(dim, int) else sizes.get(dim, size) for dim in field.dims)
            artifact.put(key, arrays[key] if key in arrays else _plausible(key, shape, field.dtype))
        artifact.facts = facts or {}
    return path


def put_scene(
    folder: Path,
    names: Iterable[str],
    arrays: Mapping[str, np.ndarray],
    facts: dict[str, Any] | None = None,
    *,
    chained: bool = False,
    **provenance: Any,
) -> list[Path]:
    """Write several artifacts with the same facts; each gets the arrays that its schema names. ``chained``:
    whether each artifact records the digests of those before it."""
    names = list(names)
    if unknown := set(arrays).difference(*(SCHEMAS[name].fields for name in names)):
        raise KeyError(f"no artifact of {names} has {unknown}")
    paths = []
    for number, name in enumerate(names):
        own = {key: values for key, values in arrays.items() if key in SCHEMAS[name].fields}
        before = names[:number] if chained else ()
        paths.append(put(folder, name, own, facts, made_from=before, **provenance))
    return paths


def digests(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Digest of each artifact in a folder, by file name, as provenance records it."""
    return {f"{name}.zarr": recorded_digest(folder / f"{name}.zarr") for name in names}


def _provenance(
    folder: Path,
    name: str,
    made_from: Iterable[str],
    *,
    stage: str | None = None,
    options: Mapping[str, Any] | None = None,
    origin: str = "synthetic",
    inputs: Mapping[str, str] | None = None,
    models: Mapping[str, str] | None = None,
) -> Provenance:
    inputs = digests(folder, made_from) | dict(inputs or {})
    return begin(stage or name, options or {}, origin, inputs, models or {})


def _plausible(key: str, shape: tuple[int, ...], dtype: str) -> np.ndarray:
    """Everything valid, trained on and registered; cameras at the origin; else zeros."""
    if key in _TIMES:
        return np.arange(*shape, dtype=dtype) * FRAME_STEP_NS
    values = np.ones(shape, dtype) if key in _ONES else np.zeros(shape, dtype)
    if key in ("camera_to_world", "intrinsics"):
        values[...] = np.eye(shape[-1])
    elif key == "up":
        values[:] = UP
    elif key == "quats":
        values[:, 0] = 1
    return values
