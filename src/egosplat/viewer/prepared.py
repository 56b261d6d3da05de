"""What all questions about a scene share: which Gaussians are seen, their neighbors and decoded features; kept in a cache."""

import contextlib
import hashlib
import os
import shutil
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.codes.decoder import decode
from egosplat.files import atomic_directory
from egosplat.geometry import Array
from egosplat.pipeline.code_hash import code_hash
from egosplat.progress import log
from egosplat.query.maps import Mask
from egosplat.query.relevancy import fold, relevancy
from egosplat.query.scene import QueryScene
from egosplat.query.scene_query import SceneIndex, index_scene
from egosplat.query.text import Texts
from egosplat.query.things import Neighbors, Surface

# Number of scenes in the cache: the one that was not opened for the longest time goes first.
MOST_SCENES = 4

# Codes decoded at a time: their values in the decoder's widest layer fit a processor's cache.
_ROWS_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scene that is ready for questions.

    Attributes:
        index: which Gaussians the frames show.
        features: (L, N, r) float32 decoded features of the Gaussians, as ``fold`` of the decoder gives them; 0 for
            Gaussians that no frame shows or that have no code.
    """

    index: SceneIndex
    features: Tensor

    @torch.inference_mode()
    def relevancy(self, texts: Texts, temperature: float) -> np.ndarray:
        """(Q, L, N) float32 relevancy of each Gaussian to each query, as ``relevancy_maps`` gives it."""
        count = len(texts.phrases)
        _, directions = fold(self.index.scene.decoder, torch.cat([texts.queries, texts.canonical]))
        values = relevancy(self.features, directions[:count], directions[count:], temperature)
        return values.movedim(-1, 0).contiguous().numpy()


def prepare(
    scene: QueryScene, sources: Iterable[Artifact], camera_to_world: Array, valid: Mask, cache: Path | None
) -> Prepared:
    """Prepare a scene for questions, or read what was prepared before.

    Args:
        sources: the artifacts of the scene; their digests name its place in the cache.
        camera_to_world: (F, 4, 4) float64, NaN without a pose; at least one frame has one.
        valid: (H, W) bool pixels that show the scene.
        cache: folder of the cache; None keeps nothing.
    """
    if cache is None:
        return _compute(scene, camera_to_world, valid)
    place = cache / _key(sources)
    with contextlib.suppress(OSError, ValueError, KeyError, zipfile.BadZipFile):
        prepared = _read(scene, place)
        os.utime(place)
        return prepared
    prepared = _compute(scene, camera_to_world, valid)
    try:
        _write(prepared, place)
        _forget_others(cache)
    except OSError as error:
        log(f"{place}: cannot be written ({error.strerror}); the next start prepares the questions again")
    return prepared


def _key(sources: Iterable[Artifact]) -> str:
    # A change of the code that prepares makes the cache stale, as it would a stage.
    parts = sorted(f"{source.path.name} {source.digest}" for source in sources)
    parts.append(code_hash(__name__, libraries=("numpy", "scipy", "torch")))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


@torch.inference_mode()
def _compute(scene: QueryScene, camera_to_world: Array, valid: Mask) -> Prepared:
    index = index_scene(scene, camera_to_world, scene.camera, valid)
    # ``fold`` gives the same decoder for every direction.
    folded, _ = fold(scene.decoder, torch.zeros(1, scene.decoder.widths[-1]))
    codes, (levels, count) = scene.code.movedim(1, 0).cpu(), scene.share.T.shape
    features = torch.zeros(levels * count, folded.widths[-1])
    seen = torch.from_numpy(index.surface.weight.T.ravel() > 0).nonzero()[:, 0]
    rows = codes.reshape(levels * count, -1)
    for chosen in seen.split(_ROWS_AT_ONCE):
        features[chosen] = decode(rows[chosen], folded)
    return Prepared(index, features.reshape(levels, count, -1))


def _write(prepared: Prepared, place: Path) -> None:
    touching = prepared.index.surface.neighbors.touching
    arrays = {
        "features": prepared.features.numpy(),
        "shares": prepared.index.surface.shares,
        "frame": prepared.index.frame,
        "data": touching.data,
        "indices": touching.indices,
        "indptr": touching.indptr,
    }
    with atomic_directory(place) as scratch:
        for name, values in arrays.items():
            np.save(scratch / f"{name}.npy", values)


def _read(scene: QueryScene, place: Path) -> Prepared:
    # Mapped instead of read: pages come from the disk when a question needs them. "c" because PyTorch wants to be
    # allowed to write.
    def load(name: str) -> np.ndarray:
        return np.load(place / f"{name}.npy", mmap_mode="c")

    count = scene.gaussians.count
    touching = csr_array((load("data"), load("indices"), load("indptr")), shape=(count, count))
    means = scene.gaussians.means.double().cpu().numpy()
    share = scene.share.cpu().numpy()
    surface = Surface.joined(means, Neighbors(touching), load("shares"), share)
    features = torch.from_numpy(load("features"))
    return Prepared(SceneIndex(scene, surface, np.array(load("frame"))), features)


def _forget_others(cache: Path) -> None:
    kept = sorted(
        (path for path in cache.iterdir() if not path.name.startswith(".")),
        key=lambda path: path.stat().st_mtime,
    )
    for path in kept[:-MOST_SCENES]:
        shutil.rmtree(path, ignore_errors=True)
