"""A wall with a box, its sign and two mugs, as a scene of LERF-OVS and of 3D-OVS: pictures, poses, points and exact labels."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

WIDTH, HEIGHT, FOCAL = 96, 72, 90.0
PICTURES = 8

# Places of the labeled pictures, from 0.
LABELED = (2, 5)


@dataclass(frozen=True)
class Plate:
    """A flat thing that faces the cameras: color, left, top, right and bottom [m], and distance [m]."""

    category: str
    color: tuple[int, int, int]
    box: tuple[float, float, float, float]
    z: float


# From the farthest to the nearest: each covers those before it.
PLATES = (
    Plate("wall", (150, 150, 140), (-3.0, -3.0, 3.0, 3.0), 3.0),
    Plate("box", (180, 60, 40), (-0.8, -0.5, 0.1, 0.6), 2.4),
    Plate("sign", (240, 230, 60), (-0.6, -0.3, -0.2, 0.0), 2.39),
    Plate("mug", (40, 90, 190), (0.3, 0.1, 0.5, 0.4), 2.2),
    Plate("mug", (40, 90, 190), (0.6, 0.1, 0.8, 0.4), 2.2),
)
CLASSES = ("box", "mug", "wall")

# Side of the squares that a thing is painted with [m]: points for the training to hold on to.
_SQUARE = 0.07


def camera_x() -> NDArray[np.float64]:
    """Place of each camera on the x axis [m]; all look along z, y points down."""
    return np.linspace(-0.35, 0.35, PICTURES)


def corners(plate: Plate, x: float) -> NDArray[np.float64]:
    """(4, 2) image points of the corners, from a camera at x."""
    left, top, right, bottom = plate.box
    points = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return (points - [x, 0.0]) * FOCAL / plate.z + [WIDTH / 2, HEIGHT / 2]


def render(x: float) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(H, W, 3) picture and (H, W) index of the visible plate, from a camera at x."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    picture, shown = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.int64)
    for index, plate in enumerate(PLATES):
        right, down = (u - WIDTH / 2) * plate.z / FOCAL + x, (v - HEIGHT / 2) * plate.z / FOCAL
        left, top, most, bottom = plate.box
        inside = (left <= right) & (right <= most) & (top <= down) & (down <= bottom)
        squares = (np.floor(right / _SQUARE) * 7 + np.floor(down / _SQUARE) * 13).astype(int) % 5
        painted = np.array(plate.color) * (0.7 + 0.1 * squares[..., None])
        picture[inside], shown[inside] = painted[inside].clip(0, 255), index
    return picture, shown


def write_lerf(root: Path, name: str = "boxes") -> Path:
    """Write ``root/boxes/`` and ``root/label/boxes/``; returns the scene's folder. Labels are whole objects."""
    names = [f"frame_{number:05d}.png" for number in range(1, PICTURES + 1)]
    _write_pictures(root / name, names)
    (root / "label" / name).mkdir(parents=True)
    for place in LABELED:
        x = camera_x()[place]
        objects = [
            {"category": plate.category, "segmentation": outline.tolist(), "bbox": [*outline[0], *outline[2]]}
            for plate in PLATES[1:]
            for outline in [corners(plate, x)]
        ]
        info = {"name": names[place], "width": WIDTH, "height": HEIGHT}
        label = root / "label" / name / f"{Path(names[place]).stem}.json"
        label.write_text(json.dumps({"info": info, "objects": objects}))
    return root / name


def write_3d_ovs(root: Path, name: str = "boxes") -> Path:
    """Write ``root/boxes/`` and return it. The sign counts as box: classes are what covers the picture."""
    _write_pictures(root / name, [f"{number:02d}.png" for number in range(PICTURES)])
    labels, categories = root / name / "segmentations", np.array([plate.category for plate in PLATES])
    categories[categories == "sign"] = "box"
    for place in LABELED:
        category = categories[render(camera_x()[place])[1]]
        (folder := labels / f"{place:02d}").mkdir(parents=True)
        for each in CLASSES:
            Image.fromarray((category == each).astype(np.uint8) * 255).save(folder / f"{each}.png")
    (labels / "classes.txt").write_text("\n".join(reversed(CLASSES)) + "\n")
    return root / name


def _write_pictures(folder: Path, names: Sequence[str]) -> None:
    """Write ``images/`` and a COLMAP model of them with points."""
    (folder / "images").mkdir(parents=True)
    (model := folder / "sparse" / "0").mkdir(parents=True)
    for name, x in zip(names, camera_x(), strict=True):
        Image.fromarray(render(x)[0]).save(folder / "images" / name)
    points = np.array([*_points()])
    images, tracks = [], [[] for _ in points]
    for number, (name, x) in enumerate(zip(names, camera_x(), strict=True), start=1):
        seen = (points[:, :2] - [x, 0.0]) * FOCAL / points[:, 2:3] + [WIDTH / 2, HEIGHT / 2]
        for place, track in enumerate(tracks):
            track.append(f"{number} {place}")
        observed = " ".join(f"{u} {v} {place + 1}" for place, (u, v) in enumerate(seen))
        images.append(f"{number} 1 0 0 0 {-x} 0 0 1 {name}\n{observed}\n")
    camera = f"1 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n"
    (model / "cameras.txt").write_text(camera)
    (model / "images.txt").write_text("".join(images))
    rows = (
        f"{place + 1} {x} {y} {z} 128 128 128 0.5 {' '.join(track)}\n"
        for place, ((x, y, z), track) in enumerate(zip(points, tracks, strict=True))
    )
    (model / "points3D.txt").write_text("".join(rows))


def _points() -> Iterator[tuple[float, float, float]]:
    for plate in PLATES:
        left, top, right, bottom = np.clip(plate.box, -1.6, 1.6)
        for x in np.linspace(left, right, 8):
            yield from ((x, y, plate.z) for y in np.linspace(top, bottom, 8))
