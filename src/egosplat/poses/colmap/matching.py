"""COLMAP's second step: match features between images and verify the matches."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pycolmap

from egosplat.poses.colmap.database import Project
from egosplat.poses.colmap.pairs import every_pair, sequential_pairs

Matching = Literal["auto", "exhaustive", "sequential"]

EXHAUSTIVE_UP_TO = 80
"""``auto`` compares every pair of up to this many images (3,160 pairs)."""

_PAIRS_PER_BATCH = 100


@dataclass(frozen=True)
class MatchingResult:
    """Statistics of feature matching.

    Attributes:
        strategy: ``exhaustive`` or ``sequential``.
        compared: number of pairs compared.
        verified: number of pairs whose matches are consistent with a rigid scene.
        with_parallax: number of verified pairs with parallax: the camera moved past objects at different depths.
        median_shift_px: median over verified pairs of the median distance between matches [px]; 0 without pairs.
    """

    strategy: str
    compared: int
    verified: int
    with_parallax: int
    median_shift_px: float


def match_images(
    project: Project, matching: Matching, overlap: int, seed: int, threads: int
) -> MatchingResult:
    """Match features between images and verify the matches geometrically.

    Args:
        project: with features.
        matching: ``exhaustive``: every pair. ``sequential``: each image with the ``overlap`` next ones, with those
            2, 4, 8, ... later, and with similar images, which closes loops. ``auto``: exhaustive for up to
            ``EXHAUSTIVE_UP_TO`` images.
        overlap: number of next images.
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
    return _summary(project, "exhaustive" if exhaustive else "sequential", len(pairs))


def _summary(project: Project, strategy: str, compared: int) -> MatchingResult:
    with pycolmap.Database.open(project.database) as database:
        pair_ids, geometries = database.read_two_view_geometries()
        keypoints = {
            image.image_id: database.read_keypoints(image.image_id) for image in database.read_all_images()
        }
    kinds = pycolmap.TwoViewGeometryConfiguration
    verified, with_parallax, shifts = 0, 0, []
    for pair_id, geometry in zip(pair_ids, geometries, strict=True):
        inliers = geometry.inlier_matches
        if len(inliers) == 0:
            continue
        verified += 1
        with_parallax += kinds(geometry.config) in (kinds.CALIBRATED, kinds.UNCALIBRATED)
        first, second = pycolmap.pair_id_to_image_pair(pair_id)
        shift = keypoints[first][inliers[:, 0], :2] - keypoints[second][inliers[:, 1], :2]
        shifts.append(float(np.median(np.linalg.norm(shift, axis=1))))
    shift_px = float(np.median(shifts)) if shifts else 0.0
    return MatchingResult(strategy, compared, verified, with_parallax, shift_px)
