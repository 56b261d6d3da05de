"""Kitchen and table objects. Every builder returns an object in its own axes, front towards +z."""

import itertools

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_glaze, some_metal, some_plastic, some_wood
from egosplat_apartments.objects.model import Model, assemble
from egosplat_apartments.objects.pictures import label, random_color
from egosplat_apartments.objects.shapes import Part, box, cushion, cylinder, ellipsoid, join, lathe, rod
from egosplat_apartments.objects.textures import Texture, make_texture, metal, motifs, speckled, stripes, wood


def coaster(rng: Rng) -> Model:
    """A round mat of cork with a picture on it, on a rim."""
    r = rng.uniform(0.055, 0.07)
    picture = motifs(rng, random_color(rng), (random_color(rng), (0.95, 0.9, 0.8)), 26, (12, 34))
    top = make_texture(picture, 2 * r, surface="flowered paper")
    cork = make_texture(speckled(rng, (0.65, 0.47, 0.28), (0.35, 0.22, 0.12)), 0.1, surface="speckled cork")
    return assemble(
        Part("mat", cylinder(r, 0, 0.008, 28), cork),
        Part("picture", cylinder(r * 0.92, 0.008, 0.01, 28), top),
    )


def cup(rng: Rng) -> Model:
    """A mug with a handle and coffee in it."""
    r, h = rng.uniform(0.038, 0.045), rng.uniform(0.085, 0.105)
    wall = lathe(
        [(0, 0), (r * 0.85, 0), (r, 0.015), (r, h), (r - 0.004, h), (r - 0.005, h * 0.8), (0, h * 0.8)]
    )
    arc = [(r + 0.028 * np.sin(a), h * 0.52 - 0.028 * np.cos(a), 0.0) for a in np.linspace(0, np.pi, 6)]
    handle = join([rod(a, b, 0.0055) for a, b in itertools.pairwise(arc)])
    glaze = some_glaze(rng)
    coffee = make_texture(speckled(rng, (0.2, 0.11, 0.06), (0.5, 0.35, 0.2), 40), 0.1)
    return assemble(
        Part("body", wall, glaze),
        Part("handle", handle, glaze),
        Part("coffee", cylinder(r * 0.87, h * 0.8, h * 0.82), coffee),
    )


def bowl(rng: Rng) -> Model:
    """A bowl of fruit."""
    r, h = rng.uniform(0.1, 0.13), 0.075
    a = np.linspace(0.25, np.pi / 2, 7)
    outer = [(r * np.sin(x), 0.008 + (h - 0.008) * (1 - np.cos(x))) for x in a]
    inner = [(radius * 0.95, height * 0.9 + 0.012) for radius, height in outer[::-1]]
    dish = lathe([(0, 0), (0.05, 0), (0.05, 0.008), *outer, *inner, (0, inner[-1][1])], 28, 50)
    places = [(0.045 * np.cos(k * 2.1), 0.06, 0.045 * np.sin(k * 2.1)) for k in range(3)]
    fruit = [
        Part(f"fruit {k}", ellipsoid((0.037, 0.035, 0.037), place, 14), _peel(rng))
        for k, place in enumerate(places)
    ]
    turned = rng.random() < 0.5
    surface = make_texture(wood(rng, (0.6, 0.4, 0.22)), 0.2, surface="wood") if turned else some_glaze(rng)
    return assemble(Part("dish", dish, surface), *fruit)


def _peel(rng: Rng) -> Texture:
    first = random_color(rng, (0.7, 0.95), (0.65, 0.95))
    return make_texture(speckled(rng, first, (first[0] * 0.5, first[1] * 0.6, 0.15), 300, 3), 0.08)


def plate(rng: Rng) -> Model:
    """A plate with a painted rim and a slice of cake."""
    dish = lathe(
        [(0, 0), (0.06, 0), (0.06, 0.004), (0.115, 0.018), (0.12, 0.022), (0.07, 0.01), (0, 0.01)], 32, 50
    )
    cake = cushion((-0.035, 0.01, -0.025), (0.035, 0.055, 0.03), 0.008)
    glaze = some_glaze(rng)
    layers = stripes(rng, ((0.45, 0.25, 0.14), (0.95, 0.88, 0.75)), 6, upright=False)
    return assemble(Part("dish", dish, glaze), Part("cake", cake, make_texture(layers, 0.05)))


def bottle(rng: Rng) -> Model:
    """A bottle with a label and a cap."""
    r, h = rng.uniform(0.034, 0.042), rng.uniform(0.24, 0.3)
    neck = r * 0.38
    shoulder = [(neck * 1.3, h * 0.8), (neck, h * 0.86), (neck, h * 0.94)]
    body = lathe([(0, 0), (r, 0), (r, h * 0.62), *shoulder, (0, h * 0.94)], sharp_deg=45)
    picture = label(
        rng, random_color(rng, (0.5, 0.9), (0.2, 0.6)), random_color(rng, (0.05, 0.4), (0.8, 0.95))
    )
    jacket = make_texture(picture, np.pi * r, h * 0.4, surface="printed paper")
    sleeve = lathe([(r + 0.001, h * 0.12), (r + 0.001, h * 0.52)])
    pattern = speckled(rng, random_color(rng, (0.4, 0.9), (0.15, 0.55)), (0.8, 0.85, 0.8), 50, 2)
    glass = make_texture(pattern, 0.1, surface="glass")
    return assemble(
        Part("body", body, glass),
        Part("label", sleeve, jacket),
        Part("cap", cylinder(neck * 1.15, h * 0.93, h), some_metal(rng)),
    )


def tea_kettle(rng: Rng) -> Model:
    """A round kettle: spout, handle, lid."""
    color = random_color(rng, (0.2, 0.9), (0.5, 0.9))
    picture = 0.6 * metal(rng, color) + 0.4 * speckled(rng, color, (0.9, 0.9, 0.9), 60, 5)
    enamel = make_texture(picture, 0.25, surface="speckled metal")
    body = lathe([(0, 0), (0.08, 0), (0.1, 0.03), (0.098, 0.08), (0.06, 0.13), (0, 0.135)], 28, 60)
    arc = [(0.085 * np.cos(a), 0.12 + 0.1 * np.sin(a), 0) for a in np.linspace(0.15, np.pi - 0.15, 9)]
    handle = join([rod(a, b, 0.008) for a, b in itertools.pairwise(arc)])
    lid = join(
        [
            lathe([(0, 0.13), (0.05, 0.134), (0.045, 0.142), (0, 0.146)]),
            ellipsoid((0.014, 0.014, 0.014), (0, 0.156, 0), 10),
        ]
    )
    return assemble(
        Part("body", body, enamel),
        Part("spout", rod((0.07, 0.05, 0), (0.155, 0.13, 0), 0.022, 0.011), enamel),
        Part("handle", handle, some_plastic(rng, (0.12, 0.1, 0.1))),
        Part("lid", lid, some_metal(rng)),
    )


def toaster(rng: Rng) -> Model:
    """A toaster with two slices in it."""
    color = random_color(rng, (0.1, 0.9), (0.6, 0.9))
    picture = 0.7 * metal(rng, color) + 0.3 * stripes(rng, (color, (0.9, 0.9, 0.9)), 6)
    body = make_texture(picture, 0.3, surface="striped metal")
    bread = [cushion((-0.055, 0.15, z - 0.012), (0.055, 0.225, z + 0.012), 0.011) for z in (-0.035, 0.035)]
    toast = make_texture(speckled(rng, (0.75, 0.55, 0.3), (0.45, 0.28, 0.12), 300), 0.1)
    feet = [cylinder(0.012, 0, 0.016, 10).moved((x, 0, z)) for x in (-0.1, 0.1) for z in (-0.05, 0.05)]
    return assemble(
        Part("body", cushion((-0.13, 0.012, -0.08), (0.13, 0.19, 0.08), 0.03), body),
        Part("slices", join(bread), toast),
        Part("lever", box((0.128, 0.11, -0.02), (0.155, 0.125, 0.02)), some_plastic(rng, (0.1, 0.1, 0.1))),
        Part("feet", join(feet), some_plastic(rng, (0.1, 0.1, 0.1))),
    )


def cutting_board(rng: Rng) -> Model:
    """A board with a loaf and a handle."""
    board = join([box((-0.16, 0, -0.11), (0.16, 0.018, 0.11)), box((0.16, 0, -0.025), (0.23, 0.018, 0.025))])
    loaf, timber = ellipsoid((0.09, 0.045, 0.05), (-0.03, 0.055, 0), 16), some_wood(rng)
    crust = make_texture(speckled(rng, (0.72, 0.48, 0.24), (0.95, 0.85, 0.65), 120, 5), 0.12)
    return assemble(Part("board", board, timber), Part("bread", loaf, crust))


def pot(rng: Rng) -> Model:
    """A cooking pot with a lid and two handles."""
    steel = make_texture(metal(rng, random_color(rng, (0.0, 0.8), (0.55, 0.85))), 0.25, surface="metal")
    body = lathe([(0, 0), (0.1, 0), (0.105, 0.01), (0.105, 0.12), (0.112, 0.124), (0, 0.124)], 28)
    handles = [rod((s * 0.1, 0.1, z), (s * 0.14, 0.1, z), 0.007) for s in (-1, 1) for z in (-0.03, 0.03)]
    handles += [rod((s * 0.14, 0.1, -0.03), (s * 0.14, 0.1, 0.03), 0.009) for s in (-1, 1)]
    lid = join(
        [
            lathe([(0.11, 0.124), (0.1, 0.135), (0.04, 0.15), (0, 0.152)], 28),
            ellipsoid((0.02, 0.015, 0.02), (0, 0.165, 0), 10),
        ]
    )
    return assemble(
        Part("body", body, steel),
        Part("handles", join(handles), some_plastic(rng, (0.1, 0.1, 0.1))),
        Part("lid", lid, some_metal(rng)),
    )
