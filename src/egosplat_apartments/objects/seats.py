"""Seats, beds and a step stool. Every builder returns an object in its own axes, front towards +z."""

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.furniture import four_legs
from egosplat_apartments.objects.materials import some_fabric, some_paint, some_wood, upholstery
from egosplat_apartments.objects.model import Model, Surface, assemble
from egosplat_apartments.objects.shapes import Part, box, cushion, join
from egosplat_apartments.objects.textures import make_texture, stripes


def couch(rng: Rng) -> Model:
    """A two- or three-seater with arms, seat and back cushions."""
    return _seat(rng, seats=int(rng.integers(2, 4)), width=0.62)


def armchair(rng: Rng) -> Model:
    """An upholstered chair with arms."""
    return _seat(rng, seats=1, width=0.6)


def _seat(rng: Rng, seats: int, width: float) -> Model:
    body, pads, feet = upholstery(rng), some_fabric(rng), some_wood(rng)
    w, arm = seats * width + 0.3, 0.15
    x0 = -w / 2
    seat, back = [], []
    for number in range(seats):
        left = x0 + arm + number * width
        seat.append(cushion((left + 0.005, 0.28, -0.22), (left + width - 0.005, 0.44, 0.42), 0.05))
        back.append(cushion((left + 0.01, 0.43, -0.3), (left + width - 0.01, 0.82, -0.12), 0.07))
    arms = [cushion((x, 0.1, -0.42), (x + arm, 0.62, 0.42), 0.05) for x in (x0, x0 + w - arm)]
    return assemble(
        Part("base", box((x0 + arm, 0.1, -0.42), (-x0 - arm, 0.29, 0.4)), body),
        Part("back", cushion((x0 + arm, 0.1, -0.45), (-x0 - arm, 0.85, -0.27), 0.05), body),
        Part("arms", join(arms), body),
        Part("seat cushions", join(seat), pads),
        Part("back cushions", join(back), pads),
        Part("feet", four_legs(w, 0.84, 0.1, 0.06), feet),
        surfaces=(Surface("soft", (x0 + arm + 0.04, -0.1), (-x0 - arm - 0.04, 0.25), 0.44),),
    )


def dining_chair(rng: Rng) -> Model:
    """Legs, a padded seat, and a back of posts and slats."""
    frame, pad = (some_wood(rng) if rng.random() < 0.6 else some_paint(rng)), some_fabric(rng)
    posts = [box((x - 0.018, 0.44, -0.21), (x + 0.018, 0.9, -0.175)) for x in (-0.18, 0.18)]
    slats = [box((-0.165, y, -0.205), (0.165, y + 0.07, -0.185)) for y in (0.56, 0.68, 0.8)]
    return assemble(
        Part("legs", four_legs(0.42, 0.42, 0.42, 0.036, 0.0), frame),
        Part("seat", box((-0.21, 0.42, -0.21), (0.21, 0.445, 0.21)), frame),
        Part("pad", cushion((-0.195, 0.445, -0.17), (0.195, 0.485, 0.2), 0.018), pad),
        Part("back", join(posts + slats), frame),
    )


def bed_frame(rng: Rng) -> Model:
    """Head board, rails, slats and legs; the mattress is an object of its own."""
    timber = some_wood(rng)
    w, d = 1.0, 1.95
    rails = [box((x - 0.02, 0.18, -d / 2), (x + 0.02, 0.32, d / 2)) for x in (-w / 2 + 0.02, w / 2 - 0.02)]
    rails.append(box((-w / 2 + 0.04, 0.18, d / 2 - 0.04), (w / 2 - 0.04, 0.32, d / 2)))
    slats = [
        box((-w / 2 + 0.04, 0.25, z), (w / 2 - 0.04, 0.27, z + 0.09)) for z in np.arange(-0.9, 0.85, 0.17)
    ]
    return assemble(
        Part("head board", box((-w / 2, 0.12, -d / 2 - 0.04), (w / 2, 0.95, -d / 2)), timber),
        Part("rails", join(rails), timber),
        Part("slats", join(slats), some_wood(rng)),
        Part("legs", four_legs(w, d, 0.18, 0.07), timber),
        surfaces=(Surface("bed", (-w / 2 + 0.04, -d / 2), (w / 2 - 0.04, d / 2 - 0.04), 0.27),),
    )


def mattress(rng: Rng) -> Model:
    """A mattress with a blanket over its foot end."""
    w, d = 0.9, 1.88
    blanket = cushion((-w / 2 - 0.003, 0.02, -0.2), (w / 2 + 0.003, 0.222, d / 2 + 0.003), 0.05)
    ticking = make_texture(
        stripes(rng, ((0.9, 0.89, 0.86), (0.72, 0.78, 0.86)), 12), 0.6, surface="striped cloth"
    )
    return assemble(
        Part("mattress", cushion((-w / 2, 0, -d / 2), (w / 2, 0.21, d / 2), 0.05), ticking),
        Part("blanket", blanket, some_fabric(rng)),
        surfaces=(Surface("soft", (-w / 2 + 0.06, -d / 2 + 0.04), (w / 2 - 0.06, -0.25), 0.21),),
    )


def step_stool(rng: Rng) -> Model:
    """Two steps between side boards."""
    timber, tread = some_paint(rng), some_wood(rng)
    sides = [
        join([box((x, 0, -0.17), (x + 0.02, 0.42, 0.0)), box((x, 0, 0.0), (x + 0.02, 0.2, 0.17))])
        for x in (-0.2, 0.18)
    ]
    treads = [box((-0.22, 0.42, -0.19), (0.22, 0.445, 0.02)), box((-0.22, 0.2, 0.0), (0.22, 0.225, 0.19))]
    brace = box((-0.18, 0.08, -0.12), (0.18, 0.14, -0.1))
    return assemble(
        Part("sides", join(sides), timber), Part("treads", join(treads), tread), Part("brace", brace, timber)
    )
