"""The things of the foreign world: the usual categories in other shapes, proportions and surfaces."""

from dataclasses import replace

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects import foreign_furniture, foreign_things
from egosplat_apartments.objects.catalogue import Kind
from egosplat_apartments.objects.materials import INSTEAD, KEPT
from egosplat_apartments.objects.model import Model, Surface
from egosplat_apartments.objects.shapes import Part
from egosplat_apartments.objects.textures import Texture

# Least and largest factor on the width, height and depth of things that keep their shape.
_PROPORTIONS = (0.82, 1.22)


def build_foreign(kind: Kind, rng: Rng) -> Model:
    """A thing of a kind: in a shape of its own if the foreign world has one, else in other proportions and surfaces."""
    name = kind.build.__name__
    for module in (foreign_furniture, foreign_things):
        if hasattr(module, name):
            return getattr(module, name)(rng)
    return restyled(kind.build(rng), rng, kind.category != "mattress")


def restyled(model: Model, rng: Rng, reshaped: bool) -> Model:
    """A model with other surfaces and, if ``reshaped``, other proportions."""
    x, y, z = rng.uniform(*_PROPORTIONS, 3).tolist() if reshaped else (1.0, 1.0, 1.0)
    other: dict[Texture, Texture] = {}
    parts: list[Part] = []
    for part in model.parts:
        if part.texture not in other:
            other[part.texture] = _instead(part.texture, rng)
        parts.append(replace(part, shape=part.shape.stretched((x, y, z)), texture=other[part.texture]))
    surfaces = (
        replace(
            one,
            lower=(one.lower[0] * x, one.lower[1] * z),
            upper=(one.upper[0] * x, one.upper[1] * z),
            height=one.height * y,
            headroom=one.headroom * y,
        )
        for one in model.surfaces
    )
    return Model(tuple(parts), tuple[Surface, ...](surfaces))


def _instead(texture: Texture, rng: Rng) -> Texture:
    """The surface in the foreign world; drawings, and surfaces without a name, stay."""
    if not texture.surface or texture.surface in KEPT:
        return texture
    return INSTEAD[texture.surface.split()[-1]](rng)
