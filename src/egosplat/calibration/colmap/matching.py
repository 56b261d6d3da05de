"""COLMAP's second step: match features between images and verify the matches."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pycolmap

from egosplat.calibration.colmap.database import Project
from egosplat.progress import log

# Names of two images.
Pair = tuple[str, str]
Matching = Literal["auto", "exhaustive", "sequential"]

# ``auto`` compares every pair of up to this many images (3,160 pairs).
EXHAUSTIVE_UP_TO = 80

_PAIRS_PER_BATCH = 100
# For every 5th image COLMAP looks up the 5 most similar ones.
_LOOP_PERIOD = 5
_LOOP_IMAGES = 5
# Descriptors per visual word that clustering needs.
_DESCRIPTORS_PER_WORD = 40
_MAX_DESCRIPTORS = 200_000
_MAX_WORDS = 4096


@dataclass(frozen=True)
class MatchingResult:
    """Statistics of feature matching.

    Attributes:
        strategy: ``exhaustive`` or ``sequential``.
        compared: number of pairs compared.
        verified: number of pairs whose matches are consistent with a rigid scene.
        with_parallax: number of verified pairs with parallax: the camera moved past objects at different depths.
    """

    strategy: str
    compared: int
    verified: int
    with_parallax: int


def match_images(
    project: Project, matching: Matching, overlap: int, seed: int, threads: int
) -> MatchingResult:
    """Match features between images and verify the matches geometrically.

    Args:
        matching: ``exhaustive``: every pair. ``sequential``: see ``sequential_pairs``. ``auto``: exhaustive for up to
            ``EXHAUSTIVE_UP_TO`` images.
        seed: of RANSAC and of the vocabulary.
        threads: number of threads; the result does not depend on it.
    """
    project.check_free_space()
    exhaustive = matching == "exhaustive" or (matching == "auto" and len(project.names) <= EXHAUSTIVE_UP_TO)
    pairs = every_pair(project) if exhaustive else sequential_pairs(project, overlap, seed)
    options = pycolmap.FeatureMatchingOptions(num_threads=threads)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    for batch in project.in_batches(pairs, _PAIRS_PER_BATCH, "COLMAP: matching images", "pair"):
        project.pairs.write_text("".join(f"{first} {second}\n" for first, second in batch))
        listed = pycolmap.ImportedPairingOptions(match_list_path=project.pairs)
        pycolmap.match_image_pairs(project.database, options, listed, verification, pycolmap.Device.cpu)
    with pycolmap.Database.open(project.database) as database:
        _, geometries = database.read_two_view_geometries()
    kinds = pycolmap.TwoViewGeometryConfiguration
    verified = [kinds(geometry.config) for geometry in geometries if len(geometry.inlier_matches)]
    with_parallax = sum(kind in (kinds.CALIBRATED, kinds.UNCALIBRATED) for kind in verified)
    strategy = "exhaustive" if exhaustive else "sequential"
    return MatchingResult(strategy, len(pairs), len(verified), with_parallax)


def every_pair(project: Project) -> list[Pair]:
    """Every pair of images."""
    with pycolmap.Database.open(project.database) as database:
        generator = pycolmap.ExhaustivePairGenerator(pycolmap.ExhaustivePairingOptions(), database)
        return _named(database, generator)


def sequential_pairs(project: Project, overlap: int, seed: int) -> list[Pair]:
    """Pairs near in time, and pairs of similar images further apart, which close loops.

    Args:
        overlap: each image is paired with this many next ones, and with those 2, 4, ..., 2^(overlap - 1) later.
        seed: of the choice of descriptors; clustering takes COLMAP's.
    """
    with pycolmap.Database.open(project.database) as database:
        near: set[Pair] = set()
        # COLMAP's quadratic overlap (offsets 1, 2, 4, ...) replaces the plain one, so both are generated.
        for quadratic in (False, True):
            options = pycolmap.SequentialPairingOptions(
                overlap=overlap, quadratic_overlap=quadratic, num_threads=1
            )
            near.update(_named(database, pycolmap.SequentialPairGenerator(options, database)))
        # COLMAP's vocabulary of visual words is a download; this one is clustered from the recording's descriptors.
        if not _write_vocabulary(project, database, seed):
            log("COLMAP: too few features for a vocabulary; loops are not closed")
            return sorted(near)
        loops = pycolmap.SequentialPairingOptions(
            overlap=1,
            quadratic_overlap=False,
            num_threads=1,
            loop_detection=True,
            loop_detection_period=_LOOP_PERIOD,
            loop_detection_num_images=_LOOP_IMAGES,
            loop_detection_min_index_distance=overlap + 1,
            vocab_tree_path=project.vocabulary,
        )
        similar = _named(database, pycolmap.SequentialPairGenerator(loops, database))
    closing = [pair for pair in similar if pair not in near]
    log(f"COLMAP: {len(near)} pairs near in time, {len(closing)} more of similar images")
    return sorted(near) + closing


def _named(database: pycolmap.Database, generator: pycolmap.PairGenerator) -> list[Pair]:
    """The generator's pairs by name, sorted and without duplicates; it also pairs images with themselves."""
    names = {image.image_id: image.name for image in database.read_all_images()}
    named = [sorted((names[first], names[second])) for first, second in generator.all_pairs()]
    return sorted({(first, second) for first, second in named if first != second})


def _write_vocabulary(project: Project, database: pycolmap.Database, seed: int) -> bool:
    """Cluster descriptors of all images into visual words; False if there are too few for a vocabulary."""
    images = sorted(database.read_all_images(), key=lambda image: image.name)
    per_image = math.ceil(_MAX_DESCRIPTORS / len(images))
    rng = np.random.default_rng(seed)
    sampled = []
    for image in images:
        descriptors = database.read_descriptors(image.image_id).to_float().data
        chosen = rng.permutation(len(descriptors))[:per_image]
        sampled.append(np.asarray(descriptors)[np.sort(chosen)])
    data = np.concatenate(sampled)
    words = min(_MAX_WORDS, len(data) // _DESCRIPTORS_PER_WORD)
    if words < 2:
        return False
    log(f"COLMAP: clustering {len(data)} descriptors into {words} visual words")
    options = pycolmap.VisualIndex.BuildOptions(
        num_visual_words=words, num_iterations=20, num_rounds=1, num_threads=1
    )
    index = pycolmap.VisualIndex.create(data.shape[1], data.shape[1] // 2)
    index.build(options, pycolmap.FeatureDescriptorsFloat(pycolmap.FeatureExtractorType.SIFT, data))
    index.write(project.vocabulary)
    return True
