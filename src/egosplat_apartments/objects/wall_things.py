"""Objects on walls. Origin at the middle of the back, which lies in the wall's plane; front towards +z."""

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_fabric, some_metal, some_paint, some_wood
from egosplat_apartments.objects.model import Model, Surface, assemble
from egosplat_apartments.objects.pictures import abstract, clock_face, landscape, random_color
from egosplat_apartments.objects.shapes import FORWARD, Part, Shape, box, cylinder, join, lathe, rod, sheet
from egosplat_apartments.objects.textures import cloth, make_texture


def wall_artwork(rng: Rng) -> Model:
    """An abstract painting on canvas, without a frame."""
    w, h = rng.uniform(0.7, 1.0), rng.uniform(0.55, 0.75)
    canvas = make_texture(abstract(rng, (320, 448)), w, h, surface="painted canvas")
    edge = make_texture(cloth(rng, (0.85, 0.82, 0.74)), 0.2, surface="canvas")
    front = sheet((-w / 2, h / 2, 0.031), (w, 0, 0), (0, -h, 0))
    return assemble(
        Part("canvas", front, canvas), Part("stretcher", box((-w / 2, -h / 2, 0), (w / 2, h / 2, 0.03)), edge)
    )


def picture(rng: Rng) -> Model:
    """A framed landscape with a mat."""
    w, h = rng.uniform(0.42, 0.6), rng.uniform(0.36, 0.5)
    mat = make_texture(cloth(rng, (0.93, 0.92, 0.88), 0.05), 0.2, surface="paper")
    inner = sheet((-w / 2 + 0.07, h / 2 - 0.07, 0.0135), (w - 0.14, 0, 0), (0, -h + 0.14, 0))
    scene = make_texture(landscape(rng, (224, 288)), w - 0.14, h - 0.14)
    frame = _frame(w, h, 0.035, 0.028)
    return assemble(
        Part("frame", frame, some_wood(rng)),
        Part("mat", box((-w / 2 + 0.03, -h / 2 + 0.03, 0), (w / 2 - 0.03, h / 2 - 0.03, 0.012)), mat),
        Part("scene", inner, scene),
    )


def _frame(w: float, h: float, border: float, depth: float) -> Shape:
    """Four bars around a rectangle."""
    x, y = w / 2, h / 2
    return join(
        [
            box((-x, y - border, 0), (x, y, depth)),
            box((-x, -y, 0), (x, -y + border, depth)),
            box((-x, -y + border, 0), (-x + border, y - border, depth)),
            box((x - border, -y + border, 0), (x, y - border, depth)),
        ]
    )


def wall_clock(rng: Rng) -> Model:
    """A round clock with a rim."""
    r = rng.uniform(0.15, 0.2)
    rim = lathe([(r * 0.9, 0), (r, 0), (r, 0.03), (r * 0.93, 0.04), (r * 0.9, 0.03), (r * 0.9, 0)], 36)
    dial = make_texture(
        clock_face(rng, random_color(rng, (0.05, 0.3), (0.85, 0.97)), (0.08, 0.08, 0.12)), 1.8 * r
    )
    return assemble(
        Part("rim", rim.moved(rotation=FORWARD), some_metal(rng) if rng.random() < 0.5 else some_wood(rng)),
        Part("dial", cylinder(r * 0.9, 0, 0.02, 36).moved(rotation=FORWARD), dial),
    )


def shelf(rng: Rng) -> Model:
    """A board on two brackets."""
    w = rng.uniform(0.7, 0.95)
    brackets = [
        join(
            [box((x - 0.012, -0.16, 0), (x + 0.012, 0, 0.02)), rod((x, -0.14, 0.015), (x, -0.01, 0.17), 0.01)]
        )
        for x in (-w / 3, w / 3)
    ]
    return assemble(
        Part("board", box((-w / 2, 0, 0), (w / 2, 0.03, 0.22)), some_wood(rng)),
        Part("brackets", join(brackets), some_metal(rng)),
        surfaces=(Surface("shelf", (-w / 2 + 0.02, 0.02), (w / 2 - 0.02, 0.21), 0.03, 0.5),),
    )


def coat_rack(rng: Rng) -> Model:
    """A board with pegs and a coat on one of them."""
    pegs = [rod((x, 0, 0.02), (x, 0.03, 0.09), 0.011) for x in (-0.24, -0.08, 0.08, 0.24)]
    folds = _folds(0.3, 0.75, 0.012, 5).moved((-0.24, -0.02, 0.06))
    return assemble(
        Part("board", box((-0.34, -0.05, 0), (0.34, 0.05, 0.022)), some_paint(rng)),
        Part("pegs", join(pegs), some_metal(rng)),
        Part("coat", folds, some_fabric(rng)),
    )


def curtain(rng: Rng) -> Model:
    """A curtain in folds that hangs from a rod next to a window."""
    w, h = 0.42, 1.75
    bar = join(
        [
            rod((-w / 2 - 0.06, 0.0, 0.075), (w / 2 + 0.06, 0.0, 0.075), 0.012),
            rod((w / 2, 0, 0), (w / 2, 0, 0.075), 0.008),
        ]
    )
    return assemble(
        Part("cloth", _folds(w, h, 0.025, 6).moved((0, -0.02, 0.075)), some_fabric(rng)),
        Part("rod", bar, some_metal(rng)),
    )


def _folds(width: float, height: float, depth: float, count: int) -> Shape:
    """Cloth that hangs from y = 0 in ``count`` waves; a closed sheet with two sides."""
    sides = []
    for sign in (1.0, -1.0):
        flat = sheet((-sign * width / 2, 0, 0), (sign * width, 0, 0), (0, -height, 0), step=0.02)
        phase = 2 * np.pi * count * flat.vertices[:, 0] / width
        vertices = flat.vertices + np.stack(
            [0 * phase, 0 * phase, depth * np.cos(phase) + sign * 0.004], axis=1
        )
        slope = depth * np.sin(phase) * 2 * np.pi * count / width
        normals = sign * np.stack([slope, 0 * phase, 1 + 0 * phase], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        sides.append(Shape(vertices, normals, flat.uv, flat.faces))
    return join(sides)
