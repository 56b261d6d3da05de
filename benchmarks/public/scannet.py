"""ScanNet by OpenGaussian's evaluation: the classes of a mesh's vertices.

    python -m benchmarks.public.scannet --prepare scans/scene0000_00
    egosplat run scans/scene0000_00 --set models.set=published
    python -m benchmarks.public.scannet results/mine/scene0000_00 scans/scene0000_00/*_vh_clean_2.labels.ply

--prepare writes transforms.json from color/, pose/ and intrinsic/, as ScanNet's reader exports them, or from
OpenGaussian's transforms_train.json and transforms_test.json. A vertex takes the class of the nearest opaque Gaussian.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from benchmarks.common import command, markdown
from egosplat.calibration.ply import read_vertices
from egosplat.errors import UserError
from egosplat.evaluation.scores import iou
from egosplat.files import read_json, write_text
from egosplat.geometry import OPENGL_AXES
from egosplat.language.decoder import decode
from egosplat.query.finished_scene import Scene, open_scene

Labels = NDArray[np.int64]

# NYU40's number of each class that is asked.
_NAMES = """wall, floor, cabinet, bed, chair, sofa, table, door, window, bookshelf, picture, counter, desk, curtain, refrigerator,
shower curtain, toilet, sink, bathtub"""
_NUMBERS = (*range(1, 13), 14, 16, 24, 28, 33, 34, 36)
CLASSES = dict(zip(_NAMES.replace("\n", " ").split(", "), _NUMBERS, strict=True))
_NOT_IN_15 = ("picture", "refrigerator", "shower curtain", "bathtub")
_NOT_IN_10 = (*_NOT_IN_15, "cabinet", "counter", "desk", "curtain", "sink")
_LEFT_OUT = {19: (), 15: _NOT_IN_15, 10: _NOT_IN_10}
SETS = {count: tuple(name for name in CLASSES if name not in out) for count, out in _LEFT_OUT.items()}

# Gaussians below this opacity are no surface.
OPAQUE = 0.1

# Mean IoU and mean accuracy of the classes, in percent, for 19, 15 and 10 of them.
PRINTED = (
    ("OpenGaussian, as printed", (24.73, 41.54), (30.13, 48.25), (38.29, 55.19)),
    ("OpenGaussian, run again (its issue 32)", (22.19, 31.56), (23.13, 32.77), (29.77, 40.23)),
    ("OpenGaussian, run again (the same)", (25.3, 36.9), (27.5, 39.5), (34.0, 47.4)),
)


class Score(NamedTuple):
    """Means over the classes that a scene has, 0..1."""

    mean_iou: float
    mean_accuracy: float


def score(truth: Labels, found: Labels) -> Score:
    """Score the classes of vertices.

    Args:
        truth: (V,) NYU40's number of each vertex, 0 for none of the classes; these vertices do not count.
        found: (V,) the same, 0 where there is no answer.

    Raises:
        UserError: no vertex is of any class.
    """
    truth, found = truth[truth > 0], found[truth > 0]
    if not len(truth):
        raise UserError("no vertex has a label of the classes that are asked")
    masks = [(found == one, truth == one) for one in np.unique(truth)]
    ious = [iou(answer, own, np.ones_like(own)) for answer, own in masks]
    accuracies = [answer[own].mean() for answer, own in masks]
    return Score(float(np.mean(ious)), float(np.mean(accuracies)))


def read_labels(path: Path) -> tuple[NDArray[np.float64], Labels]:
    """(V, 3) vertices and their (V,) labels."""
    table = read_vertices(path)
    if not {"x", "y", "z", "label"} <= set(table.dtype.names):
        raise UserError(f"{path}: its vertices have no label; give scene0000_00_vh_clean_2.labels.ply")
    places = np.stack([table[axis] for axis in "xyz"], axis=1)
    return places.astype(np.float64), table["label"].astype(np.int64)


def similarities(scene: Scene, names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """(M, 3) means of the opaque Gaussians with a code of the coarsest level, and (M, Q) cosines with names."""
    trained = scene.trained
    kept = (trained.gaussians.opacities >= OPAQUE) & (trained.share[:, -1] > 0)
    if not kept.any():
        raise UserError(f"{scene.artifact('language').path}: no opaque Gaussian has a code")
    with torch.inference_mode():
        features = decode(trained.code[kept][:, -1], trained.decoder)
        cosines = features @ scene.encode(names).queries.to(features).T
    return trained.gaussians.means[kept].double().cpu().numpy(), cosines.cpu().numpy()


def score_scene(scene: Scene, labels: Path) -> dict[int, Score]:
    """Score a finished scene for 19, 15 and 10 classes."""
    points, truth = read_labels(labels)
    means, cosines = similarities(scene, tuple(CLASSES))
    nearest = cKDTree(means).query(points, workers=-1)[1]
    return {count: _score_set(names, truth, cosines[nearest]) for count, names in SETS.items()}


def _score_set(names: Sequence[str], truth: Labels, cosines: NDArray[np.float32]) -> Score:
    numbers = np.array([CLASSES[name] for name in names])
    columns = [list(CLASSES).index(name) for name in names]
    asked = np.where(np.isin(truth, numbers), truth, 0)
    return score(asked, numbers[cosines[:, columns].argmax(axis=1)])


def prepare(scan: Path, every: int) -> Path:
    """Write ``transforms.json`` of every n-th picture of a scan; returns its path.

    Raises:
        UserError: the folder has no poses, or it is prepared already.
    """
    target = scan / "transforms.json"
    if target.exists():
        raise UserError(f"{target}: is there already; remove it to prepare the scan again")
    splits = [path for name in ("train", "test") if (path := scan / f"transforms_{name}.json").exists()]
    document = _merged(scan, splits) if splits else _exported(scan, every)
    points = next(iter([*scan.glob("points3d.ply"), *scan.glob("*_vh_clean_2.ply")]), None)
    if points is not None:
        document["ply_file_path"] = points.name
    write_text(target, json.dumps(document))
    return target


def _merged(scan: Path, splits: Sequence[Path]) -> dict[str, Any]:
    """One document of OpenGaussian's two, whose pictures are named without their ending."""
    documents = [read_json(path) for path in splits]
    frames = [frame for one in documents for frame in one.get("frames", [])]
    if not all(isinstance(frame.get("file_path"), str) for frame in frames):
        raise UserError(f"{splits[0]}: a frame has no file_path; prepare the scan again")
    for frame in frames:
        path = scan / frame["file_path"]
        ending = next((ending for ending in (".jpg", ".png", "") if Path(f"{path}{ending}").is_file()), None)
        if ending is None:
            raise UserError(f"{path}: no such picture, .jpg or .png; unpack color.zip into {scan}")
        frame["file_path"] = Path(f"{path}{ending}").relative_to(scan).as_posix()
    return documents[0] | {"frames": frames}


def _exported(scan: Path, every: int) -> dict[str, Any]:
    """The document of a scan as ScanNet's reader exports it; frames whose pose was lost are left out."""
    pictures = sorted((scan / "color").glob("*.jpg"), key=lambda path: (len(path.stem), path.stem))
    intrinsic = scan / "intrinsic" / "intrinsic_color.txt"
    if not pictures or not intrinsic.is_file():
        raise UserError(f"{scan}: lacks color/*.jpg or intrinsic/intrinsic_color.txt; export the .sens file")
    width, height = Image.open(pictures[0]).size
    matrix = _matrix(intrinsic)
    if not 0.25 < matrix[0, 2] / width < 0.75:
        raise UserError(f"{intrinsic}: is not that of pictures of {width} x {height}, as color/ has them")
    poses = {path: _matrix(scan / "pose" / f"{path.stem}.txt") for path in pictures[::every]}
    frames = [
        {"file_path": f"color/{path.name}", "transform_matrix": (pose * OPENGL_AXES).tolist()}
        for path, pose in poses.items()
        if np.isfinite(pose).all()
    ]
    numbers = {"fl_x": matrix[0, 0], "fl_y": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    return {"camera_model": "PINHOLE", "w": width, "h": height, **numbers, "frames": frames}


def _matrix(path: Path) -> NDArray[np.float64]:
    try:
        found = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError):
        found = np.empty(0)
    if found.shape != (4, 4):
        raise UserError(f"{path}: is no matrix of 4 rows of 4 numbers; export the .sens file again")
    return found


def _cells(scores: Sequence[tuple[float, float]]) -> list[str]:
    return [f"{mean_iou:.1f} / {accuracy:.1f}" for mean_iou, accuracy in scores]


@command(__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("labels", required=False, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--prepare", "preparing", is_flag=True, help="Write FOLDER/transforms.json of a scan.")
@click.option("--every", default=20, show_default=True, help="Of the exported pictures, as OpenGaussian.")
def main(folder: Path, labels: Path | None, preparing: bool, every: int) -> None:
    """Prepare a scan, or score a finished scene."""
    if preparing:
        return click.echo(f"wrote {prepare(folder, every)}")
    if labels is None:
        raise UserError("give the labels of the mesh, too: scene0000_00_vh_clean_2.labels.ply")
    found = score_scene(open_scene(folder), labels)
    own = [(100 * one.mean_iou, 100 * one.mean_accuracy) for one in found.values()]
    rows = [["**EgoSplat, this scene**", *_cells(own)]]
    rows += [[name, *_cells(scores)] for name, *scores in PRINTED]
    click.echo("ScanNet, mean over classes: IoU / accuracy (%); papers' rows are means of ten scenes\n")
    click.echo(markdown(("method", *(f"{count} classes" for count in SETS)), rows))


if __name__ == "__main__":
    main()
