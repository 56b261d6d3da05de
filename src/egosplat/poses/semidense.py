"""The semi-dense point cloud of Project Aria's Machine Perception Services (MPS).

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
from egosplat.poses.trajectory import FARTHEST_M
from egosplat.progress import track

FILE_NAMES = ("semidense_points.csv.gz", "global_points.csv.gz")
"""The current name of the file and its older one."""

GRAY = 128
"""The cameras that make the cloud are monochrome and the file holds no colour."""

_POSITION = ["px_world", "py_world", "pz_world"]
_COLUMNS = [*_POSITION, "inv_dist_std", "dist_std"]
_ROWS_AT_A_TIME = 1_000_000


@dataclass(frozen=True)
class SemidensePoints:
    """The points that passed the filter.

    Attributes:
        points: (P, 3) float64 [m].
        read: number of points in the file.
        rejected: how many each criterion rejects; a point may fail several.
    """

    points: NDArray[np.float64]
    read: int
    rejected: dict[str, int]


def find_points(folder: Path) -> Path | None:
    """The point cloud in the MPS folder ``folder``, or None."""
    return next((folder / name for name in FILE_NAMES if (folder / name).is_file()), None)


def read_semidense_points(path: Path, max_inv_dist_std: float, max_dist_std: float) -> SemidensePoints:
    """Read the points that are located well enough (docs/method.md#point-filter).

    The file is read in pieces, so that memory holds the kept points and one piece only.

    Args:
        path: ``semidense_points.csv.gz``, or the same table not compressed.
        max_inv_dist_std: points whose inverse distance has a standard deviation below this are kept [1/m].
        max_dist_std: and whose distance has one below this [m].

    Raises:
        UserError: the file is damaged or lacks a column.
    """
    kept, rejected, read = [], dict.fromkeys(("not_finite", "too_far", "inv_dist_std", "dist_std"), 0), 0
    try:
        with pd.read_csv(path, usecols=_COLUMNS, dtype=np.float64, chunksize=_ROWS_AT_A_TIME) as pieces:
            for piece in track(pieces, f"reading {path.name}", unit="block"):
                position = piece[_POSITION].to_numpy()
                failed = {
                    "not_finite": ~np.isfinite(position).all(axis=1),
                    "too_far": (np.abs(position) > FARTHEST_M).any(axis=1),
                    "inv_dist_std": ~(piece["inv_dist_std"].to_numpy() < max_inv_dist_std),
                    "dist_std": ~(piece["dist_std"].to_numpy() < max_dist_std),
                }
                kept.append(position[~np.logical_or.reduce(list(failed.values()))])
                read += len(piece)
                for name, mask in failed.items():
                    rejected[name] += int(mask.sum())
    except (ValueError, pd.errors.ParserError, gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise UserError(f"{path} is not a readable MPS point cloud ({error}); download it again") from error
    return SemidensePoints(np.concatenate([np.empty((0, 3)), *kept]), read, rejected)
