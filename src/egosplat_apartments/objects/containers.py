"""Baskets, boxes, bins, vases. Every builder returns an object in its own axes, front towards +z."""

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_fabric, some_glaze, some_metal, some_plastic
from egosplat_apartments.objects.model import Model, assemble
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, box, cushion, cylinder, ellipsoid, join, lathe, leaf, rod
from egosplat_apartments.objects.textures import checks, cloth, make_texture, motifs, speckled, wicker


def trash_can(rng: Rng) -> Model:
    """A tapering bin with a rim, a domed lid and a pedal."""
    body = some_plastic(rng, random_color(rng, (0.1, 0.8), (0.35, 0.85)))
    pail = lathe([(0, 0), (0.12, 0), (0.155, 0.36), (0.165, 0.36), (0.165, 0.39), (0, 0.39)])
    lid = lathe([(0.16, 0.39), (0.155, 0.42), (0.11, 0.45), (0, 0.465)])
    bands = join(
        [lathe([(0.13, 0.1), (0.142, 0.1), (0.146, 0.15), (0.134, 0.15)]), cylinder(0.02, 0.46, 0.49)]
    )
    pedal = box((-0.035, 0.01, 0.1), (0.035, 0.025, 0.19))
    return assemble(
        Part("pail", pail, body),
        Part("lid", lid, some_metal(rng)),
        Part(
            "band",
            bands,
            make_texture(checks(rng, (0.9, 0.9, 0.85), random_color(rng)), 0.1, surface="checked plastic"),
        ),
        Part("pedal", pedal, some_plastic(rng, (0.1, 0.1, 0.1))),
    )


def clothes_basket(rng: Rng) -> Model:
    """A wicker basket with handles and laundry in it."""
    straw = make_texture(wicker(rng, (0.72, 0.55, 0.34)), 0.22, surface="wicker")
    wall = lathe(
        [(0, 0), (0.19, 0), (0.24, 0.4), (0.25, 0.4), (0.25, 0.42), (0.22, 0.42), (0.215, 0.36), (0, 0.36)]
    )
    handles = [rod((x, 0.45, -0.06), (x, 0.45, 0.06), 0.014) for x in (-0.235, 0.235)]
    posts = [rod((x, 0.41, z), (x, 0.45, z), 0.012) for x in (-0.235, 0.235) for z in (-0.06, 0.06)]
    cloths = [
        cushion((-0.17, 0.36, -0.12), (0.06, 0.42, 0.12), 0.028),
        cushion((-0.04, 0.36, -0.1), (0.17, 0.445, 0.13), 0.03),
    ]
    return assemble(
        Part("basket", wall, straw),
        Part("handles", join(handles + posts), straw),
        *(Part(f"laundry {number}", shape, some_fabric(rng)) for number, shape in enumerate(cloths)),
    )


def box_with_lid(rng: Rng) -> Model:
    """A decorative box: body, lid and a ribbon around both."""
    ribbon = some_fabric(rng)
    w, h, d = rng.uniform(0.18, 0.24), rng.uniform(0.1, 0.15), rng.uniform(0.14, 0.18)
    band = [box((-0.012, 0, -d / 2 - 0.006), (0.012, h + 0.003, d / 2 + 0.006))]
    band += [ellipsoid((0.03, 0.014, 0.016), (x, h + 0.014, 0), 10) for x in (-0.028, 0.028)]
    picture = motifs(rng, random_color(rng, (0.3, 0.7)), (random_color(rng),), 50, (5, 15))
    paper = make_texture(picture, 0.2, surface="flowered paper")
    lid_shape = box((-w / 2 - 0.004, h - 0.035, -d / 2 - 0.004), (w / 2 + 0.004, h, d / 2 + 0.004))
    return assemble(
        Part("body", box((-w / 2, 0, -d / 2), (w / 2, h - 0.035, d / 2)), paper),
        Part("lid", lid_shape, some_fabric(rng)),
        Part("ribbon", join(band), ribbon),
    )


def tissue_box(rng: Rng) -> Model:
    """A printed box with a tissue coming out."""
    ground, ink = random_color(rng, (0.2, 0.6), (0.6, 0.9)), random_color(rng)
    picture = motifs(rng, ground, (ink, (0.95, 0.95, 0.9)), 40, (8, 26))
    card = make_texture(picture, 0.22, surface="flowered paper")
    tissue = [
        leaf(0.09, 0.08, 0.02).moved((0, 0.09, 0), Rotation.from_euler("YX", [turn, -1.2]))
        for turn in (0.3, 2.2, 4.4)
    ]
    paper = make_texture(cloth(rng, (0.92, 0.92, 0.92), 0.06), 0.1, surface="paper")
    return assemble(
        Part("box", box((-0.115, 0, -0.06), (0.115, 0.09, 0.06)), card), Part("tissue", join(tissue), paper)
    )


def vase(rng: Rng) -> Model:
    """A glazed vase with stems and blossoms in it."""
    belly, neck, h = rng.uniform(0.055, 0.08), rng.uniform(0.022, 0.035), rng.uniform(0.2, 0.3)
    t = np.linspace(0, 1, 9)
    radius = neck + (belly - neck) * np.sin(np.pi * np.clip(t * 1.15, 0, 1)) ** 1.2
    inner = [(neck - 0.006, h), (neck - 0.008, h * 0.8), (0, h * 0.8)]
    body = lathe(
        [(0, 0), (belly * 0.5, 0), *zip(np.maximum(radius, neck), t * h, strict=True), *inner], sharp_deg=50
    )
    tips = [(rng.uniform(-0.08, 0.08), h + rng.uniform(0.1, 0.2), rng.uniform(-0.08, 0.08)) for _ in range(5)]
    stems = [rod((0, h * 0.8, 0), tip, 0.004) for tip in tips]
    blossoms = [ellipsoid((0.028, 0.022, 0.028), tip, 10) for tip in tips]
    return assemble(
        Part("body", body, some_glaze(rng)),
        Part("stems", join(stems), make_texture(cloth(rng, (0.2, 0.45, 0.18)), 0.1)),
        Part(
            "blossoms",
            join(blossoms),
            make_texture(
                speckled(rng, random_color(rng, (0.6, 0.95), (0.7, 0.95)), (0.95, 0.9, 0.4), 40, 9), 0.08
            ),
        ),
    )
