"""The surfaces of a person's limbs, and clothes."""

from dataclasses import dataclass

import numpy as np

from egosplat_apartments.objects.materials import some_fabric
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, Shape, cushion, ellipsoid, join, rod
from egosplat_apartments.objects.textures import Rng, Texture, cloth, make_texture, noise, shaded, speckled
from egosplat_apartments.people.figure import FOREARM, SHIN, THIGH, UPPER_ARM


@dataclass(frozen=True)
class Clothes:
    """Textures of a person."""

    skin: Texture
    shirt: Texture
    trousers: Texture
    hair: Texture
    shoes: Texture


def random_clothes(rng: Rng) -> Clothes:
    """Random clothes, skin and hair."""
    tones = ((0.86, 0.66, 0.52), (0.62, 0.42, 0.3), (0.4, 0.27, 0.2), (0.93, 0.76, 0.65))
    skin = tones[rng.integers(len(tones))]
    hair = ((0.15, 0.1, 0.08), (0.45, 0.3, 0.15), (0.6, 0.58, 0.55))[rng.integers(3)]
    return Clothes(
        make_texture(shaded(skin, 0.06 * noise(rng, (128, 128), 1.2)), 0.3, surface="skin"),
        some_fabric(rng),
        make_texture(cloth(rng, random_color(rng, (0.2, 0.6), (0.2, 0.5)), 0.25), 0.3, surface="plain cloth"),
        make_texture(shaded(hair, 0.25 * noise(rng, (128, 128), 0.8, 8.0)), 0.2, surface="hair"),
        make_texture(
            speckled(rng, random_color(rng, (0.1, 0.8), (0.2, 0.8)), (0.9, 0.9, 0.9), 60),
            0.2,
            surface="leather",
        ),
    )


def limb_parts(limb: str, clothes: Clothes) -> tuple[Part, ...]:
    """The surfaces of a limb in its own axes."""
    match limb.split()[-1]:
        case "pelvis":
            return (Part(limb, ellipsoid((0.17, 0.15, 0.12), (0, 0.0, 0)), clothes.trousers),)
        case "torso":
            trunk = [
                ellipsoid((0.165, 0.3, 0.115), (0, 0.24, 0)),
                ellipsoid((0.2, 0.16, 0.115), (0, 0.37, 0)),
            ]
            return (
                Part(limb, join(trunk), clothes.shirt),
                Part("neck", rod((0, 0.46, 0), (0, 0.58, 0), 0.052), clothes.skin),
            )
        case "head":
            return _head_parts(clothes)
        case "arm":
            return (Part(limb, rod((0, 0, 0), (0, UPPER_ARM, 0), 0.055, 0.045), clothes.shirt),)
        case "forearm":
            sleeve = rod((0, -0.01, 0), (0, FOREARM * 0.62, 0), 0.045, 0.04)
            return (
                Part("sleeve", sleeve, clothes.shirt),
                Part(limb, rod((0, 0.1, 0), (0, FOREARM, 0), 0.036, 0.028), clothes.skin),
            )
        case "hand":
            return (Part(limb, _hand(-1.0 if limb.startswith("left") else 1.0), clothes.skin),)
        case "thigh":
            return (Part(limb, rod((0, 0, 0), (0, THIGH, 0), 0.085, 0.062), clothes.trousers),)
        case "shin":
            return (Part(limb, rod((0, 0, 0), (0, SHIN, 0), 0.062, 0.045), clothes.trousers),)
        case _:
            return (Part(limb, cushion((-0.045, -0.05, -0.04), (0.045, 0.19, 0.045), 0.035), clothes.shoes),)


def _head_parts(clothes: Clothes) -> tuple[Part, ...]:
    """Parts of the head: y points to its top, z to the face."""
    eyes = [ellipsoid((0.012, 0.009, 0.006), (x, 0.2, 0.095), 8) for x in (-0.034, 0.034)]
    ears = [ellipsoid((0.012, 0.03, 0.02), (x, 0.185, 0.0), 8) for x in (-0.08, 0.08)]
    face = [
        ellipsoid((0.078, 0.115, 0.098), (0, 0.18, 0)),
        rod((0, 0.2, 0.09), (0, 0.165, 0.108), 0.011),
        *ears,
    ]
    hair = [
        ellipsoid((0.084, 0.085, 0.1), (0, 0.235, -0.022)),
        ellipsoid((0.075, 0.09, 0.05), (0, 0.17, -0.062)),
    ]
    white = make_texture(np.full((16, 16, 3), 0.12), 0.1)
    return (
        Part("face", join(face), clothes.skin),
        Part("hair", join(hair), clothes.hair),
        Part("eyes", join(eyes), white),
    )


def _hand(side: float) -> Shape:
    """A palm with four fingers along +y, slightly spread, and a thumb towards the middle of the body."""
    palm = cushion((-0.018, -0.02, -0.042), (0.018, 0.085, 0.042), 0.016)
    roots = [(0.0, 0.075, z) for z in (-0.032, -0.011, 0.011, 0.032)]
    fingers = [
        rod(root, (side * 0.006, 0.155 - 6 * root[2] ** 2, root[2] * 1.25), 0.0095, 0.007) for root in roots
    ]
    thumb = rod((0.0, 0.02, 0.04), (side * 0.01, 0.085, 0.072), 0.011, 0.008)
    return join([palm, *fingers, thumb])
