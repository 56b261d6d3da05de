"""COLMAP's second step: match features between images and verify the matches."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from egosplat.calibration.colmap.database import Project
from egosplat.progress import log

# Names of two images.
Pair = tuple[str, str]

# ``auto`` compares every pair of up to this many images (3,160 pairs).
EXHAUSTIVE_UP_TO = 80

_PAIRS_PER_BATCH = 100
# For every 5th image COLMAP looks up the 5 most similar ones.
_LOOP_PERIOD = _LOOP_IMAGES = 5
# Descriptors per visual word that clustering needs.
_DESCRIPTORS_PER_WORD = 40
_MAX_DESCRIPTORS, _MAX_WORDS = 200_000, 4096


def match_images(project: Project, matching: str, overlap: int, seed: int, threads: int) -> dict[str, Any]:
    """Match features between images and verify the matches geometrically, by the same result for any number of threads.

    ``auto`` is ``exhaustive`` (every pair) for up to ``EXHAUSTIVE_UP_TO`` images, else ``sequential``. Returns the one that was used, and
    the numbers of pairs that were compared, that fit to a rigid scene, and of these with parallax.
    """
    project.check_free_space()
    if matching == "auto":
        matching = "exhaustive" if len(project.names) <= EXHAUSTIVE_UP_TO else "sequential"
    every = [*itertools.combinations(project.names, 2)]
    pairs = every if matching == "exhaustive" else sequential_pairs(project, overlap, seed)
    options = pycolmap.FeatureMatchingOptions(num_threads=threads)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
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


def sequential_pairs(project: Project, overlap: int, seed: int) -> list[Pair]:
    """Pairs near in time, and pairs of similar images further apart, which close loops.

    Each image is paired with ``overlap`` next ones, and with those 2, 4, ..., 2^(overlap - 1) later. ``seed`` is of the choice of
    descriptors; clustering takes COLMAP's.
    """
    names = project.names
    offsets = {*range(1, overlap + 1), *(2**power for power in range(overlap))}
    near = sorted(pair for offset in offsets for pair in zip(names, names[offset:], strict=False))
    # COLMAP's vocabulary of visual words is a download; this one is clustered from the recording's descriptors.
    vocabulary = project.folder / "vocabulary.bin"
    with pycolmap.Database.open(project.database) as database:
        _write_vocabulary(vocabulary, database, seed)
        if not vocabulary.exists():
            log("COLMAP: too few features for a vocabulary; loops are not closed")
            return near
        loops = pycolmap.SequentialPairingOptions(
            overlap=1,
            quadratic_overlap=False,
            num_threads=1,
            loop_detection=True,
            loop_detection_period=_LOOP_PERIOD,
            loop_detection_num_images=_LOOP_IMAGES,
            loop_detection_min_index_distance=overlap + 1,
            vocab_tree_path=vocabulary,
        )
        similar = pycolmap.SequentialPairGenerator(loops, database).all_pairs()
        name_of = {image.image_id: image.name for image in database.read_all_images()}
    # The generator also pairs images with themselves, and with the next.
    closing = {tuple(sorted((name_of[first], name_of[second]))) for first, second in similar} - {*near}
    found = sorted((first, second) for first, second in closing if first != second)
    log(f"COLMAP: {len(near)} pairs near in time, {len(found)} more of similar images")
    return near + found


def _write_vocabulary(path: Path, database: pycolmap.Database, seed: int) -> None:
    """Cluster descriptors of all images into visual words, unless there are too few for a vocabulary."""
    images = sorted(database.read_all_images(), key=lambda image: image.name)
    per_image = math.ceil(_MAX_DESCRIPTORS / len(images))
    rng = np.random.default_rng(seed)
    sampled = []
    for image in images:
        descriptors = np.asarray(database.read_descriptors(image.image_id).to_float().data)
        sampled.append(descriptors[np.sort(rng.permutation(len(descriptors))[:per_image])])
    data = np.concatenate(sampled)
    words = min(_MAX_WORDS, len(data) // _DESCRIPTORS_PER_WORD)
    if words < 2:
        return
    log(f"COLMAP: clustering {len(data)} descriptors into {words} visual words")
    options = pycolmap.VisualIndex.BuildOptions(
        num_visual_words=words, num_iterations=20, num_rounds=1, num_threads=1
    )
    index = pycolmap.VisualIndex.create(data.shape[1], data.shape[1] // 2)
    index.build(options, pycolmap.FeatureDescriptorsFloat(pycolmap.FeatureExtractorType.SIFT, data))
    index.write(path)
