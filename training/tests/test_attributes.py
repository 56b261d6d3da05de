"""Colors have the names that people use, and captions have words for all surfaces."""

import numpy as np
import pytest

from egosplat_apartments.objects.catalogue import CORE, GROUPS, REST
from training.small_models.attributes import COLORS, color_of
from training.small_models.captions import MATERIALS, PATTERNS

KINDS = {kind.prototype: kind for kind in (*CORE, *REST, *(one for group in GROUPS for one in group))}


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((200, 30, 30), "red"),
        ((20, 20, 160), "blue"),
        ((150, 200, 240), "blue"),
        ((30, 120, 40), "green"),
        ((250, 250, 250), "white"),
        ((10, 10, 10), "black"),
        ((120, 75, 40), "brown"),
        ((240, 150, 190), "pink"),
        ((250, 220, 40), "yellow"),
        ((128, 128, 128), "grey"),
    ],
)
def test_colors_have_their_names(rgb: tuple[int, int, int], name: str) -> None:
    assert COLORS[color_of(np.array([rgb], dtype=np.uint8))[0]] == name


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_every_object_has_a_known_surface(kind) -> None:
    model = kind.build(np.random.default_rng(3))
    surfaces = [part.texture.surface for part in model.parts if part.texture.surface]
    assert surfaces, "no part has a named surface"
    for surface in surfaces:
        *patterns, material = surface.split()
        assert material in MATERIALS
        assert all(pattern in PATTERNS for pattern in patterns)
