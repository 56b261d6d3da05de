"""The true colors of a synthetic apartment's things, from its surfaces, by the rule of the captions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.recording import Instance
from egosplat.frames.rectify import pinhole
from egosplat.geometry import CLOCKWISE
from egosplat.pipeline.config import Config
from egosplat_apartments.camera.lens import pinhole_lens
from egosplat_apartments.stage import make_renderer
from egosplat_apartments.world.world import World, camera_pose, make_world
from training.small_models.attributes import COLORS, find_appearance
from training.small_models.captions import MAIN_SHARE, TRACE_SHARE

# Pictures from which it is counted how much is seen of each surface: their side [px], and how many there are.
SIDE, MOMENTS = 128, 40

Shares = NDArray[np.float64]


def color_shares(film: Config, instances: Sequence[Instance]) -> Shares:
    """Share of each color in the visible surface of each instance, over the recording.

    Args:
        film: the keys of the section ``synthetic`` that the recording was made with.
        instances: N of them, as annotated.

    Returns:
        (N, len(COLORS)) float64; NaN where nothing is seen of an instance.

    Raises:
        UserError: these keys make other instances.
    """
    world = make_world(**{key: film[key] for key in ("seed", "seconds", "objects", "motion", "world")})
    numbers = {one.instance_id: one.name for one in world.instances}
    if other := [one.name for one in instances if numbers.get(one.id) != one.name]:
        raise UserError(
            f"synthetic.seed = {film['seed']} makes no {other[0]}; give the configuration of the recording"
        )
    seen = _seen_parts(world, film["seconds"])
    owner = np.array([world.geometry.bodies[body].instance_id for body in world.geometry.part_body])
    colors = find_appearance(world.geometry).colors.astype(np.float64)
    weighted = np.stack([(seen[:, None] * colors)[owner == one.id].sum(axis=0) for one in instances])
    total = weighted.sum(axis=1, keepdims=True)
    return np.divide(weighted, total, out=np.full_like(weighted, np.nan), where=total > 0)


def main_color(shares: Shares) -> str | None:
    """The color of a thing in captions; None if none prevails, or if the thing is not visible."""
    if np.isnan(shares).any() or shares.max() < MAIN_SHARE:
        return None
    return COLORS[int(shares.argmax())]


def is_doubtful(shares: Shares, color: str) -> bool:
    """Whether it is neither true nor false that a thing has a color."""
    share = shares[COLORS.index(color)]
    return main_color(shares) != color and not share < TRACE_SHARE


def _seen_parts(world: World, seconds: float) -> Shares:
    """(P,) pixels in which each part is seen, over pictures evenly through the recording."""
    renderer = make_renderer(world, pinhole_lens(pinhole(SIDE, 460.0)))
    seen = np.zeros(len(world.geometry.part_names))
    for moment in (np.arange(MOMENTS) + 0.5) * seconds / MOMENTS:
        pose = camera_pose(world, moment) @ CLOCKWISE
        faces = renderer.picture(pose, world.body_poses(moment), 1.0, np.random.default_rng(0)).faces
        seen += np.bincount(world.geometry.face_part[faces[faces >= 0]], minlength=len(seen))
    return seen
