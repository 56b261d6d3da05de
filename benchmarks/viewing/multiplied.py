"""A scene with many Gaussians: copies of those of a finished scene, each a little displaced."""

import shutil
from pathlib import Path

import numpy as np

from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import LANGUAGE, SPLATS
from egosplat.artifacts.writer import create

# Standard deviation of the displacement of a copy, in standard deviations of the Gaussian.
SPREAD = 0.5

# Artifacts with a row for each Gaussian of the training, in the order in which they are made.
OF_GAUSSIANS = {schema.name: schema for schema in (SPLATS, LANGUAGE)}


def multiply(scene: Path, folder: Path, copies: int) -> Path:
    """Write a scene whose Gaussians are ``copies`` times those of a finished one; everything else is linked.

    Returns:
        The folder.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for path in scene.glob("*.zarr"):
        # Histories are of the Gaussians that they were found with.
        if path.stem not in (*OF_GAUSSIANS, "histories"):
            (folder / path.name).symlink_to(path.resolve(), target_is_directory=True)
    for name, schema in OF_GAUSSIANS.items():
        _write(open_artifact(scene / f"{name}.zarr", schema), schema, folder, copies)
    return folder


def _write(given: Artifact, schema: Schema, folder: Path, copies: int) -> None:
    digests = dict(given.provenance["inputs"])
    if schema is LANGUAGE:
        digests["splats.zarr"] = open_artifact(folder / "splats.zarr", SPLATS).digest
    record = begin(schema.name, given.provenance["options"], given.origin, digests, {})
    with create(folder / f"{schema.name}.zarr", schema, record) as artifact:
        for name in given.arrays:
            values = given.read(name)
            if schema.fields[name].dims[0] == "gaussian":
                values = np.concatenate([values] * copies)
            if name == "means":
                values = _displaced(values, given)
            artifact.put(name, values)
        artifact.facts = dict(given.facts)


def _displaced(means: np.ndarray, given: Artifact) -> np.ndarray:
    count = given.shape("means")[0]
    scales = np.tile(np.exp(given.read("log_scales")), (len(means) // count, 1))
    steps = np.random.default_rng(0).normal(size=means.shape) * SPREAD * scales
    steps[:count] = 0
    return (means + steps).astype(np.float32)
