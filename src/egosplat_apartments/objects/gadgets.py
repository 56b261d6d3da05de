"""Books and devices. Every builder returns an object in its own axes, front towards +z."""

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_metal, some_plastic, some_wood
from egosplat_apartments.objects.model import Model, assemble
from egosplat_apartments.objects.pictures import clock_face, cover, keys, landscape, random_color, spine
from egosplat_apartments.objects.shapes import (
    FORWARD,
    Part,
    box,
    cushion,
    cylinder,
    ellipsoid,
    join,
    lathe,
    rod,
    sheet,
)
from egosplat_apartments.objects.textures import checks, make_texture, metal, stripes


def book_standing(rng: Rng) -> Model:
    """One volume as it stands in a bookcase, its spine forward."""
    w, h, d = rng.uniform(0.035, 0.06), rng.uniform(0.2, 0.27), rng.uniform(0.15, 0.19)
    color = random_color(rng)
    title = np.rot90(spine(rng, color), -1)
    front = make_texture(cover(rng, color), d, h, surface="printed paper")
    paper = make_texture(stripes(rng, ((0.93, 0.9, 0.82), (0.85, 0.81, 0.72)), 40), 0.05, surface="paper")
    spine_shape = box((-w / 2, 0, d / 2 - 0.003), (w / 2, h, d / 2))
    covers = join([box((x, 0, -d / 2), (x + 0.003, h, d / 2 - 0.003)) for x in (-w / 2, w / 2 - 0.003)])
    return assemble(
        Part("pages", box((-w / 2 + 0.003, 0.004, -d / 2), (w / 2 - 0.003, h - 0.004, d / 2 - 0.003)), paper),
        Part("spine", spine_shape, make_texture(title, w, h, surface="printed paper")),
        Part("covers", covers, front),
    )


def book_lying(rng: Rng) -> Model:
    """A book on its back cover."""
    w, h, d = rng.uniform(0.14, 0.19), rng.uniform(0.025, 0.045), rng.uniform(0.2, 0.26)
    color = random_color(rng)
    paper = make_texture(
        stripes(rng, ((0.93, 0.9, 0.82), (0.82, 0.78, 0.7)), 30, upright=False), 0.04, surface="paper"
    )
    front = make_texture(cover(rng, color), w, d, surface="printed paper")
    pages = box((-w / 2 + 0.003, 0.003, -d / 2 + 0.004), (w / 2 - 0.004, h - 0.003, d / 2 - 0.004))
    spine_shape = box((-w / 2, 0.003, -d / 2), (-w / 2 + 0.003, h - 0.003, d / 2))
    return assemble(
        Part("pages", pages, paper),
        Part("cover", box((-w / 2, h - 0.003, -d / 2), (w / 2, h, d / 2)), front),
        Part("back cover", box((-w / 2, 0, -d / 2), (w / 2, 0.003, d / 2)), front),
        Part("spine", spine_shape, make_texture(spine(rng, color), d, h, surface="printed paper")),
    )


def magazine(rng: Rng) -> Model:
    """A thin magazine lying open-side right."""
    sheets = make_texture(
        stripes(rng, ((0.95, 0.95, 0.93), (0.7, 0.7, 0.7)), 10, upright=False), 0.01, surface="paper"
    )
    front = make_texture(
        cover(rng, random_color(rng, (0.5, 0.95), (0.6, 0.95))), 0.21, 0.28, surface="printed paper"
    )
    return assemble(
        Part("pages", box((-0.104, 0, -0.139), (0.104, 0.007, 0.139)), sheets),
        Part("cover", box((-0.105, 0.007, -0.14), (0.105, 0.009, 0.14)), front),
    )


def laptop(rng: Rng) -> Model:
    """An open laptop, switched on."""
    shell = make_texture(metal(rng, (0.6, 0.61, 0.64)), 0.3, surface="metal")
    tilt = Rotation.from_euler("x", -15, degrees=True)
    hinge = (0, 0.016, -0.1)
    screen = sheet((-0.155, 0.205, 0.0055), (0.31, 0, 0), (0, -0.185, 0)).moved(hinge, tilt)
    board = sheet((-0.145, 0.0165, -0.085), (0.29, 0, 0), (0, 0, 0.115))
    return assemble(
        Part("base", box((-0.165, 0, -0.115), (0.165, 0.016, 0.115)), shell),
        Part(
            "keyboard",
            board,
            make_texture(keys(rng, (0.75, 0.75, 0.78), (0.1, 0.1, 0.12)), 0.29, 0.115, surface="plastic"),
        ),
        Part("lid", box((-0.165, 0, -0.005), (0.165, 0.215, 0.005)).moved(hinge, tilt), shell),
        Part("screen", screen, make_texture(landscape(rng, (160, 256)), 0.31, 0.185), glow=0.5),
    )


def desk_clock(rng: Rng) -> Model:
    """An alarm clock with feet and two bells."""
    case = some_plastic(rng, random_color(rng, (0.6, 0.95), (0.5, 0.9)))
    rim = [(0.065, 0.02), (0.065, 0.025), (0.056, 0.025), (0.056, 0.02)]
    body = lathe([(0, -0.025), (0.06, -0.025), *rim, (0, 0.02)], 28)
    face = cylinder(0.055, 0.02, 0.0215, 28)
    dial = make_texture(clock_face(rng, (0.95, 0.94, 0.88), (0.08, 0.08, 0.1)), 0.11)
    bells = [ellipsoid((0.022, 0.016, 0.022), (x, 0.145, 0), 12) for x in (-0.032, 0.032)]
    feet = [rod((x * 1.3, 0.006, 0), (x, 0.035, 0), 0.007) for x in (-0.035, 0.035)]
    return assemble(
        Part("case", body.moved((0, 0.08, 0), FORWARD), case),
        Part("dial", face.moved((0, 0.08, 0), FORWARD), dial),
        Part("bells", join(bells), some_metal(rng)),
        Part("feet", join(feet), some_metal(rng)),
    )


def speaker(rng: Rng) -> Model:
    """A box with two cones."""
    cones = [
        lathe([(r, 0.0), (r, 0.012), (r * 0.85, 0.012), (r * 0.3, 0.002), (0, 0.005)]).moved(
            (0, y, 0.08), FORWARD
        )
        for r, y in ((0.055, 0.085), (0.03, 0.19))
    ]
    grille = make_texture(
        checks(rng, (0.1, 0.1, 0.11), (0.32, 0.32, 0.35), 16), 0.12, surface="checked cloth"
    )
    return assemble(
        Part("case", box((-0.075, 0, -0.08), (0.075, 0.25, 0.08)), some_wood(rng)),
        Part("cones", join(cones), grille),
    )


def remote_control(rng: Rng) -> Model:
    """A remote control with its buttons up."""
    buttons = make_texture(
        keys(rng, (0.1, 0.1, 0.12), (0.75, 0.3, 0.25), 9, 3), 0.04, 0.15, surface="plastic"
    )
    case_shape = cushion((-0.025, 0, -0.09), (0.025, 0.02, 0.09), 0.009)
    return assemble(
        Part("case", case_shape, some_plastic(rng, (0.12, 0.12, 0.13))),
        Part("buttons", sheet((-0.02, 0.0205, -0.075), (0.04, 0, 0), (0, 0, 0.15)), buttons),
    )


def television(rng: Rng) -> Model:
    """A flat screen on a foot, switched on."""
    black, picture = some_plastic(rng, (0.08, 0.08, 0.09)), landscape(rng, (288, 512))
    w, h = 1.06, 0.6
    screen = sheet((-w / 2 + 0.02, h + 0.06, 0.0205), (w - 0.04, 0, 0), (0, -h + 0.04, 0))
    return assemble(
        Part("frame", box((-w / 2, 0.08, -0.03), (w / 2, h + 0.08, 0.02)), black),
        Part("screen", screen, make_texture(picture, w - 0.04, h - 0.04), glow=0.5),
        Part("stem", box((-0.06, 0.02, -0.03), (0.06, 0.08, 0.0)), black),
        Part("foot", box((-0.22, 0, -0.12), (0.22, 0.02, 0.12)), some_metal(rng)),
    )
