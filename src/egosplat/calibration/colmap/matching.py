"""COLMAP's second step: match features between images and verify the matches."""

import itertools
import math
from typing import Any

import numpy as np
import pycolmap
from scipy.cluster.vq import kmeans2, vq

from egosplat.arrays import Floats
from egosplat.calibration.colmap.database import Project
from egosplat.progress import log

# Of COLMAP's random choices. Trainings with several seeds have the same poses.
SEED = 0

# Images later that each is compared with, beside those 1, 2, 4, 8, ... later and those that look alike.
OVERLAP = 8

# Names of two images.
Pair = tuple[str, str]

# ``auto`` compares every pair of up to this many images (435 pairs).
EXHAUSTIVE_UP_TO = 30

_PAIRS_PER_BATCH = 100
# Images that each is compared with because they look alike; centers of descriptors, and of how many.
_ALIKE, _CENTERS, _SAMPLE = 5, 64, 20_000
# Images that are compared with all others at once: those of an hour have 5 GB of likenesses.
_ROWS = 512
_TINY = 1e-6


def match_images(project: Project, matching: str, threads: int) -> dict[str, Any]:
    """Match features between images and verify the matches geometrically, by the same result for any number of threads.

    ``auto`` is ``exhaustive`` (every pair) for up to ``EXHAUSTIVE_UP_TO`` images, else ``sequential``. Returns the one that was used, and
    the numbers of pairs that were compared, that fit to a rigid scene, and of these with parallax.
    """
    project.check_free_space()
    if matching == "auto":
        matching = "exhaustive" if len(project.names) <= EXHAUSTIVE_UP_TO else "sequential"
    every = itertools.combinations(project.names, 2)
    pairs = [*every] if matching == "exhaustive" else sequential_pairs(project)
    options = pycolmap.FeatureMatchingOptions(num_threads=threads)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    listed = pycolmap.ImportedPairingOptions(match_list_path=project.folder / "pairs.txt")
    for batch in project.in_batches(pairs, _PAIRS_PER_BATCH, "COLMAP: matching images", "pair"):
        listed.match_list_path.write_text("".join(f"{first} {second}\n" for first, second in batch))
        pycolmap.match_image_pairs(project.database, options, listed, verification, pycolmap.Device.cpu)
    with pycolmap.Database.open(project.database) as database:
        _, geometries = database.read_two_view_geometries()
    kinds = pycolmap.TwoViewGeometryConfiguration
    verified = [kinds(geometry.config) for geometry in geometries if len(geometry.inlier_matches)]
    return {
        "matching": matching,
        "pairs_compared": len(pairs),
        "pairs_verified": len(verified),
        "pairs_with_parallax": sum(kind in (kinds.CALIBRATED, kinds.UNCALIBRATED) for kind in verified),
    }


def sequential_pairs(project: Project, overlap: int = OVERLAP) -> list[Pair]:
    """Pairs near in time, and pairs of images further apart that look alike, which close loops.

    Each image is paired with ``overlap`` next ones, with those 2, 4, ..., 2^(overlap - 1) later, and with the ``_ALIKE``
    that look most like it.
    """
    names, looks = project.names, _looks(project)
    offsets = {*range(1, overlap + 1), *(2**power for power in range(overlap))}
    near = {pair for offset in offsets for pair in zip(names, names[offset:], strict=False)}
    alike = set()
    likenesses = (looks[first : first + _ROWS] @ looks.T for first in range(0, len(looks), _ROWS))
    for number, likeness in enumerate(itertools.chain.from_iterable(likenesses)):
        likeness[max(0, number - overlap) : number + overlap + 1] = -np.inf
        best = [other for other in np.argsort(-likeness, kind="stable")[:_ALIKE] if likeness[other] > -np.inf]
        alike |= {(names[min(number, other)], names[max(number, other)]) for other in best}
    log(f"COLMAP: {len(near)} pairs near in time, {len(alike - near)} more of images that look alike")
    return sorted(near | alike)


def _looks(project: Project) -> Floats:
    """(F, D) float32 vectors, whose products are large for images that look alike.

    Around centers of all descriptors, they add up where an image's own lie (VLAD; Jegou et al. 2010).
    """
    rng = np.random.default_rng(SEED)
    with pycolmap.Database.open(project.database) as database:
        images = sorted(database.read_all_images(), key=lambda image: image.name)

        def read(image: pycolmap.Image) -> Floats:
            return np.asarray(database.read_descriptors(image.image_id).data, np.float32)

        per_image = math.ceil(_SAMPLE / len(images))
        sample = np.concatenate([rng.permutation(read(image))[:per_image] for image in images])
        centers, _ = kmeans2(sample, min(_CENTERS, len(sample)), minit="points", rng=rng)
        looks = np.zeros((len(images), *centers.shape), np.float32)
        for row, image in enumerate(images):
            descriptors = read(image)
            nearest, _ = vq(descriptors, centers)
            np.add.at(looks[row], nearest, descriptors - centers[nearest])
    # Each center counts alike, however many features an image has there; without features an image looks like none.
    for axis in (-1, (-2, -1)):
        norm: Any = np.linalg.norm(looks, axis=axis, keepdims=True)
        looks /= np.maximum(norm, _TINY)
    return looks.reshape(len(images), -1)
