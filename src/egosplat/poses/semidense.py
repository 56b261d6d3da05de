"""Read the semi-dense point cloud of Project Aria's Machine Perception Services (MPS).

Format: projectaria_tools, "MPS output - Semi-dense point cloud": a gzipped table with the columns ``uid``,
``graph_uid``, ``px_world``, ``py_world``, ``pz_world`` [m], ``inv_dist_std`` [1/m] and ``dist_std`` [m].
"""

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.poses.trajectory import MAX_POSITION_M
from egosplat.progress import track

FILE_NAMES = ("semidense_points.csv.gz", "global_points.csv.gz")
"""Current and older name of the file."""

# The cameras that observe the points are monochrome, so the file has no colours.
GRAY = 128

_POSITION = ["px_world", "py_world", "pz_world"]
_COLUMNS = [*_POSITION, "inv_dist_std", "dist_std"]
# The file is read in blocks, so that memory holds the kept points and one block.
_ROWS_PER_BLOCK = 1_000_000


@dataclass(frozen=True)
class SemidensePoints:
    """Points that pass the filter.

    Attributes:
        points: (P, 3) float64 [m].
        read: number of points in the file.
        rejected: number of points that fail each criterion; a point may fail several.
    """

    points: NDArray[np.float64]
    read: int
    rejected: dict[str, int]


def find_points(folder: Path) -> Path | None:
    """Path of the point cloud in an MPS folder; None if there is none."""
    return next((folder / name for name in FILE_NAMES if (folder / name).is_file()), None)


def read_semidense_points(path: Path, max_inv_dist_std: float, max_dist_std: float) -> SemidensePoints:
    """Read the points with a small position uncertainty (docs/method.md#point-filter).

    Args:
        path: ``semidense_points.csv.gz``, or the uncompressed table.
        max_inv_dist_std: limit of the standard deviation of the inverse distance [1/m].
        max_dist_std: limit of the standard deviation of the distance [m].

    Raises:
        UserError: the file is damaged or lacks a column.
    """
    kept, rejected, read = [], dict.fromkeys(("not_finite", "too_far", "inv_dist_std", "dist_std"), 0), 0
    try:
        with pd.read_csv(path, usecols=_COLUMNS, dtype=np.float64, chunksize=_ROWS_PER_BLOCK) as blocks:
            for block in track(blocks, f"reading {path.name}", unit="block"):
                position = block[_POSITION].to_numpy()
                failed = {
                    "not_finite": ~np.isfinite(position).all(axis=1),
                    "too_far": (np.abs(position) > MAX_POSITION_M).any(axis=1),
                    "inv_dist_std": ~(block["inv_dist_std"].to_numpy() < max_inv_dist_std),
                    "dist_std": ~(block["dist_std"].to_numpy() < max_dist_std),
                }
                kept.append(position[~np.logical_or.reduce(list(failed.values()))])
                read += len(block)
                for name, mask in failed.items():
                    rejected[name] += int(mask.sum())
    except (ValueError, pd.errors.ParserError, gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise UserError(f"{path} is not a readable MPS point cloud ({error}); download it again") from error
    return SemidensePoints(np.concatenate([np.empty((0, 3)), *kept]), read, rejected)
