"""Take Gaussians that another program trained on the recording: in the world of the poses, checked by rendering."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.similarity import moved, split_similarity
from egosplat.gaussians.training_views import Views, read_views
from egosplat.geometry import compose
from egosplat.progress import log
from egosplat.splats.source_reader import read_source

Matrix = NDArray[np.float64]

# Pictures that are compared, and their longer side [px].
_VIEWS, _SIDE = 8, 256

# A pixel is compared where Gaussians hide this share of what is behind them, and pictures if so many pixels are.
_OPAQUE, _LEAST_SHOWN = 0.5, 0.005

# By how much a render must be nearer to the pictures than one color for each of them [dB].
_LEAST_GAIN = 3.0

# What nerfstudio applies to COLMAP's world where its transforms.json does not say so.
_OLD_APPLIED = [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]


@dataclass(frozen=True)
class Fit:
    """How well Gaussians fit the pictures, on the pixels that they cover.

    Attributes:
        world: where they were taken to be.
        psnr: of the renders [dB]; -inf if they cover too little.
        plain: of the best single color for each picture [dB].
    """

    world: str
    psnr: float
    plain: float

    @property
    def holds(self) -> bool:
        """Whether they fit."""
        return self.psnr >= self.plain + _LEAST_GAIN


def import_gaussians(
    files: list[Path], frames: Artifact, poses: Artifact, settings: RenderSettings, device: torch.device
) -> tuple[Gaussians, dict[str, Any]]:
    """Read Gaussians, and bring them to the world of ``poses``.

    Args:
        files: of ``source_files``.
        settings: to render with.

    Returns:
        The Gaussians on ``device``, and facts.

    Raises:
        UserError: a file is damaged, or the Gaussians do not fit the pictures in any known world.
    """
    gaussians = read_source(files[0])
    log(f"{files[0]}: {gaussians.count} Gaussians, spherical harmonics of degree {gaussians.sh_degree}")
    views = _compared(frames, poses, device)
    tried = []
    for world, matrix in known_worlds(files[1:], poses):
        placed = moved(gaussians, matrix).to(device)
        tried.append(fit(placed, views, settings, world))
        if tried[-1].holds:
            told = f"PSNR {tried[-1].psnr:.1f} dB, of single colors {tried[-1].plain:.1f} dB"
            log(f"world: {world}; {told} in {len(views)} pictures")
            return placed, {
                "file": files[0].name,
                "world": world,
                "psnr": tried[-1].psnr,
                "plain_psnr": tried[-1].plain,
                "to_world": matrix.tolist(),
            }
    raise _no_fit(files, max(tried, key=lambda one: one.psnr - one.plain), tried[0])


def _no_fit(files: list[Path], best: Fit, first: Fit) -> UserError:
    if np.isinf(best.psnr):
        found = "show nothing in the pictures"
    else:
        found = (
            f"do not fit the pictures: PSNR {first.psnr:.1f} dB, at best {best.psnr:.1f} dB ({best.world}), and a fit "
            f"needs {best.plain + _LEAST_GAIN:.1f} dB, {_LEAST_GAIN:g} more than single colors"
        )
    lacking = (
        "" if files[1:] else "; for nerfstudio, put the training's dataparser_transforms.json beside the file"
    )
    return UserError(
        f"{files[0]}: its Gaussians {found}.\n"
        f"Give the folder with the poses that they were trained on as the recording{lacking}"
    )


def _compared(frames: Artifact, poses: Artifact, device: torch.device) -> Views:
    rows = np.flatnonzero(poses.read("registered"))
    chosen = np.zeros(frames.shape("rgb")[0], bool)
    chosen[rows[np.linspace(0, len(rows) - 1, min(_VIEWS, len(rows))).round().astype(int)]] = True
    return read_views(frames, poses, chosen, device, resolution=_SIDE)


@torch.no_grad()
def fit(gaussians: Gaussians, views: Views, settings: RenderSettings, world: str) -> Fit:
    """Compare renders with the pictures where the Gaussians cover them: an edited scene may show a part alone."""
    count, error, spread, shown = 0, 0.0, 0.0, 0
    for index in range(len(views)):
        image, alpha, _ = render(
            gaussians,
            views.camera,
            views.camera_to_world[index],
            settings,
            sh_degree=gaussians.sh_degree,
            background=settings.still_background,
        )
        picture, weight = views.picture(index), views.weight(index)
        valid = torch.ones_like(picture[..., 0], dtype=torch.bool) if weight is None else weight > 0.5
        covered = valid & (alpha[..., 0] >= _OPAQUE)
        shown += int(valid.sum())
        count += int(covered.sum())
        if covered.any():
            truth = picture[covered].double()
            error += float((image[..., :3][covered].clamp(0, 1) - truth).square().sum())
            spread += float((truth - truth.mean(dim=0)).square().sum())
    if count < _LEAST_SHOWN * shown or not count:
        return Fit(world, -np.inf, 0.0)
    return Fit(world, *(_psnr(squares / (3 * count)) for squares in (error, spread)))


def _psnr(mean_square: float) -> float:
    # A byte's rounding is the least error of a picture.
    return -10 * float(np.log10(max(mean_square, 1e-6)))


def known_worlds(transforms: list[Path], poses: Artifact) -> Iterator[tuple[str, Matrix]]:
    """The worlds that programs train in, the likely first: names, and (4, 4) similarities to the world of ``poses``.

    Args:
        transforms: nerfstudio's file, if there is one.

    Raises:
        UserError: that file is damaged.
    """
    notes = poses.facts.get("notes", {})
    unit = np.diag([*[poses.provenance["options"].get("meters_per_unit") or 1.0] * 3, 1.0])
    given = notes.get("applied_transform")
    applied = [_square(one) for one in ([given] if given else [np.eye(4)[:3].tolist(), _OLD_APPLIED])]
    for path in transforms:
        for one in applied:
            undone = np.linalg.inv(_nerfstudio(path, one, notes.get("applied_scale", 1.0)))
            yield f"nerfstudio's, undone by {path.name}", compose(unit, undone)
    yield "the recording's", unit
    if not np.array_equal(unit, np.eye(4)):
        yield "the recording's, in meters", np.eye(4)
    if (gsplat := notes.get("gsplat_world")) is not None:
        yield "gsplat's normalized world", compose(unit, np.linalg.inv(np.array(gsplat)))
    scale = np.diag([*[notes.get("applied_scale", 1.0)] * 3, 1.0])
    yield "COLMAP's, before applied_transform", compose(unit, compose(scale, applied[-1]))
    for axes, diagonal in (("y and z", [1, -1, -1]), ("x and y", [-1, -1, 1]), ("x and z", [-1, 1, -1])):
        yield f"the recording's with {axes} reversed", compose(unit, np.diag([*diagonal, 1.0]))
    for name, sign in (("y up", 1.0), ("z up", -1.0)):
        quarter = np.array([[1, 0, 0, 0], [0, 0, -sign, 0], [0, sign, 0, 0], [0, 0, 0, 1]], float)
        yield f"the recording's turned to {name}", compose(unit, quarter)


def _nerfstudio(path: Path, applied: Matrix, applied_scale: float) -> Matrix:
    """(4, 4) similarity from the world of the recording to that in which nerfstudio trains."""
    try:
        document = read_json(path)
        whole = compose(_square(document["transform"]), np.linalg.inv(applied))
        whole[:3] *= float(document["scale"]) / applied_scale
        split_similarity(whole)
    except (OSError, ValueError, KeyError, TypeError, np.linalg.LinAlgError) as error:
        raise UserError(
            f"{path}: has no transform of 3 rows of 4 numbers with a scale ({str(error)[:100]}). Copy it again from the "
            "folder of the training"
        ) from error
    return whole


def _square(rows: Any) -> Matrix:
    return np.vstack([np.array(rows, dtype=np.float64).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
