"""Take Gaussians that another program trained on the recording: in the world of the poses, checked by rendering."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.similarity import moved, split_similarity
from egosplat.gaussians.training_views import Views, read_views
from egosplat.geometry import Array, compose
from egosplat.images import evenly_spaced
from egosplat.progress import log
from egosplat.splats.source_reader import read_source

# Pictures that are compared, and their longer side [px].
_VIEWS, _SIDE = 8, 256

# A pixel is compared where Gaussians hide this share of what is behind them, and a picture if this share of its pixels is.
_OPAQUE, _LEAST_SHOWN = 0.5, 0.005

# By how much a render must be nearer to a picture than one color [dB]. On a real desk, whole and cut to parts: 7 dB and more
# in its own world, 3 dB and less if it is 3 % of its size or 10 degrees beside it.
_LEAST_GAIN = 5.0

# Rank of that picture among all, from the worst, where Gaussians cover most of the pictures and where they do not. What others
# hid in the whole scene shows where a part is cut out.
_MOST, _MIDDLE, _BETTER = 0.5, 0.5, 0.75

# What nerfstudio applies to COLMAP's world where its transforms.json does not say so.
_OLD_APPLIED = [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]


class Fit(NamedTuple):
    """How well Gaussians fit a picture, on the pixels that they cover: PSNR of the render and of the best single color [dB].

    ``psnr`` is -inf if they cover too little of every picture."""

    psnr: float
    plain: float


def import_gaussians(
    files: list[Path], frames: Artifact, poses: Artifact, settings: RenderSettings, device: torch.device
) -> tuple[Gaussians, dict[str, Any]]:
    """Read Gaussians of ``source_files``, and bring them to the world of ``poses``, on ``device``; and facts
    (UserError: a file is damaged, or the Gaussians do not fit the pictures in any known world)."""
    gaussians = read_source(files[0])
    log(f"{files[0]}: {gaussians.count} Gaussians, spherical harmonics of degree {gaussians.sh_degree}")
    rows = np.flatnonzero(poses.read("registered"))
    chosen = np.zeros(frames.shape("rgb")[0], bool)
    chosen[rows[evenly_spaced(len(rows), _VIEWS)]] = True
    views = read_views(frames, poses, chosen, device, resolution=_SIDE)
    tried = {}
    for world, matrix in known_worlds(files[1:], poses):
        placed = moved(gaussians, matrix).to(device)
        psnr, plain = tried[world] = fit(placed, views, settings)
        if psnr >= plain + _LEAST_GAIN:
            log(f"world: {world}; PSNR {psnr:.1f} dB, of a single color {plain:.1f} dB")
            facts = {"file": files[0].name, "world": world, "psnr": psnr, "plain_psnr": plain}
            return placed, facts | {"to_world": matrix.tolist()}
    raise _no_fit(files, tried)


def _no_fit(files: list[Path], tried: dict[str, Fit]) -> UserError:
    best = max(tried, key=lambda world: tried[world].psnr - tried[world].plain)
    psnr, plain = tried[best]
    problem = "show nothing in the pictures"
    if np.isfinite(psnr):
        problem = (
            f"do not fit the pictures: PSNR at best {psnr:.1f} dB ({best}), and a fit needs "
            f"{plain + _LEAST_GAIN:.1f} dB, {_LEAST_GAIN:g} more than a single color"
        )
    lacking = "; for nerfstudio, put the training's dataparser_transforms.json beside the file"
    return UserError(
        f"{files[0]}: its Gaussians, scales read as natural logarithms, {problem}.\n"
        f"Give the folder with the poses that they were trained on as the recording{'' if files[1:] else lacking}"
    )


def fit(gaussians: Gaussians, views: Views, settings: RenderSettings) -> Fit:
    """Compare renders with the pictures where the Gaussians cover them: an edited scene may show a part alone."""
    compared = [_compare(gaussians, views, settings, index) for index in range(len(views))]
    shown = [Fit(psnr, plain) for psnr, plain, share in compared if share >= _LEAST_SHOWN]
    if not shown:
        return Fit(-np.inf, 0.0)
    shown.sort(key=lambda fit: fit.psnr - fit.plain)
    rank = _MIDDLE if np.mean([share for *_, share in compared]) >= _MOST else _BETTER
    return shown[int(rank * (len(shown) - 1))]


@torch.no_grad()
def _compare(
    gaussians: Gaussians, views: Views, settings: RenderSettings, index: int
) -> tuple[float, float, float]:
    """PSNR of a render and of one color, laid over the picture where the render covers it [dB], and the share covered."""
    pose, degree = views.camera_to_world[index], gaussians.sh_degree
    image, alpha, _ = render(gaussians, views.camera, pose, settings, sh_degree=degree, background=None)
    picture, weight = views.picture(index), views.weight(index)
    covered = alpha[..., 0] >= _OPAQUE
    if weight is not None:
        covered &= weight > 0.5
    share, truth = alpha[covered].double(), picture[covered].double()
    color = (share.square() * truth).sum(dim=0) / share.square().sum()
    errors = image[..., :3][covered].double() - share * truth, share * (color - truth)
    # A byte's rounding is the least error of a picture.
    psnr, plain = (-10 * math.log10(max(float(error.square().mean()), 1e-6)) for error in errors)
    return psnr, plain, float(covered.float().mean())


def known_worlds(transforms: list[Path], poses: Artifact) -> Iterator[tuple[str, Array]]:
    """The worlds that programs train in, the likely first: names, and (4, 4) similarities to the world of ``poses``.

    UserError if nerfstudio's file among ``transforms`` is damaged."""
    notes = poses.facts.get("notes", {})
    unit = np.diag([*[poses.provenance["options"].get("meters_per_unit") or 1.0] * 3, 1.0])
    given = notes.get("applied_transform")
    applied = [_square(rows) for rows in ([given] if given else [np.eye(4)[:3].tolist(), _OLD_APPLIED])]
    for path in transforms:
        for matrix in applied:
            undone = np.linalg.inv(_nerfstudio(path, matrix, notes.get("applied_scale", 1.0)))
            yield f"nerfstudio's, undone by {path.name}", compose(unit, undone)
    yield "the recording's", unit
    if not np.array_equal(unit, np.eye(4)):
        yield "the recording's, in meters", np.eye(4)
    scale = np.diag([*[notes.get("applied_scale", 1.0)] * 3, 1.0])
    yield "COLMAP's, before applied_transform", compose(unit, compose(scale, applied[-1]))
    for axes, diagonal in (("y and z", [1, -1, -1]), ("x and y", [-1, -1, 1]), ("x and z", [-1, 1, -1])):
        yield f"the recording's with {axes} reversed", compose(unit, np.diag([*diagonal, 1.0]))
    for name, sign in (("y up", 1.0), ("z up", -1.0)):
        quarter = np.array([[1, 0, 0, 0], [0, 0, -sign, 0], [0, sign, 0, 0], [0, 0, 0, 1]], float)
        yield f"the recording's turned to {name}", compose(unit, quarter)


def _nerfstudio(path: Path, applied: Array, applied_scale: float) -> Array:
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


def _square(rows: Any) -> Array:
    return np.vstack([np.array(rows, dtype=np.float64).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
