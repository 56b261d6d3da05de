"""Cells of a long recording: what each trains on, and the scene that the Gaussians of all make."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from egosplat.arrays import Array, Bools
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import TRAINED
from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import ground_axes, lie_within, rotate
from egosplat.pipeline.survey_file import digest_of
from egosplat.pipeline.validation import read_document


@dataclass(frozen=True, eq=False)
class Cell:
    """A part of the ground: (2, 2) lower and upper ``limits`` along the (2, 3) ``axes`` of the ground [m], the (2,) ``margin`` by which
    the part is wider from which it trains [m], and the (F,) bool ``frames`` that it may train on."""

    limits: Array
    axes: Array
    margin: Array
    frames: Bools

    def holds(self, points: Array, wider: bool = False) -> Bools:
        """(P,) bool: which of (P, 3) points lie in the cell, or in the ``wider`` part. Each finite point lies in one cell."""
        margin = self.margin * wider
        return lie_within(rotate(self.axes, points), self.limits + np.stack([-margin, margin]))


def read_cells(survey_path: Path | None, poses: Artifact) -> tuple[list[Cell], str]:
    """The cells of a survey, none without one, and a digest of them (UserError: it cannot be read)."""
    given = [] if survey_path is None else read_document(survey_path, "survey")["cells"]
    axes, every = ground_axes(poses.read("up")), np.arange(poses.shape("registered")[0])
    cells = [
        Cell(np.array(cell["limits"]), axes, np.array(cell["margin"]), np.isin(every, cell["frames"]))
        for cell in given
    ]
    return cells, digest_of(given)


def join_gaussians(parts: Sequence[Artifact], cells: Sequence[Cell], offsets: Array) -> Gaussians:
    """The Gaussians of each cell's artifact whose centers it holds, moved and dimmed by its (6,) offset, see ``join_corrections``."""
    joined = []
    for part, cell, offset in zip(parts, cells, torch.from_numpy(offsets).float(), strict=True):
        every = replace(read_gaussians(part), features=torch.from_numpy(part.read("features")))
        own = every.select(torch.from_numpy(cell.holds(every.means.double().numpy())))
        dimmed = (-offset[3:]).exp()
        sh = own.sh * dimmed
        sh[:, 0] += (dimmed - 1.0) * 0.5 / SH_C0  # a color is the sum and a half
        joined.append(replace(own, means=own.means + offset[:3], sh=sh))
    return Gaussians.concatenate(joined)


def join_corrections(
    parts: Sequence[Artifact], cells: Sequence[Cell], centers: Array
) -> tuple[dict[str, Array], Array]:
    """The corrections of each frame, by the cell that holds its camera's center (F, 3), and (C, 6) offsets of cells: of their places
    [m], and of the logarithms of their gains. The corrections of a cell have a mean of their own; offsets bring those of frames
    that several cells train on together, in least squares. Turns stay as they are."""
    names = ("camera_to_world", "source", "shift", "turn", "gain")
    every = {name: np.stack([part.read(f"corrections/{name}") for part in parts]) for name in names}
    known = np.concatenate([every["shift"], np.log(every["gain"])], axis=2)
    seen = every["source"] == TRAINED
    times = np.maximum(seen.sum(axis=0), 1)
    apart = (known - (known * seen[..., None]).sum(axis=0) / times[:, None]) * seen[..., None]
    offsets = -np.linalg.pinv(np.diag(seen.sum(axis=1)) - (seen / times) @ seen.T) @ apart.sum(axis=1)
    held = np.stack([cell.holds(centers) for cell in cells])
    owner = held.argmax(axis=0)
    # A frame without a pose is in no cell, and stays as it is.
    moved = offsets[owner] * held.any(axis=0, keepdims=True).T
    own = {name: values[owner, np.arange(len(owner))] for name, values in every.items()}
    own["shift"] += moved[:, :3]
    own["camera_to_world"][:, :3, 3] += moved[:, :3]
    own["gain"] *= np.exp(moved[:, 3:])
    return own, offsets
