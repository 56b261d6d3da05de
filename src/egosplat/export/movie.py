"""A moving picture of a scene that is asked (``egosplat movie``): the camera goes to each answer, which lights up."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from egosplat.arrays import Array, Floats, Reals
from egosplat.artifacts.schemas import lies_on_its_side
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.gaussians.initialization import SH_C0
from egosplat.geometry import known_poses
from egosplat.images import evenly_spaced
from egosplat.progress import log, track
from egosplat.query.answers import Answer, Thing
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import GUESS
from egosplat.query.scene import QueryScene, rendering_camera

# Largest number of views on the way to an answer, steps in which it lights up, and times of a step and of an answer [ms].
_STEPS, _LIGHTS, _STEP_MS, _ANSWER_MS = 16, 4, 90, 1800

# Height of the text, relative to the longer side.
_LINE = 0.085

# Color of an answer, a red of the color map Turbo, with its share; the rest is the own brightness. Brightness of all else.
_HOT, _STRENGTH, _DIM = (195.0, 37.0, 3.0), 0.75, 0.6


def run(scene: Scene, phrases: Sequence[str], output: Path, side: int) -> None:
    """Ask a scene one phrase or more, and write a moving picture of the answers as WebP, ``side`` px on its
    longer side (UserError: no query has an answer; also as ``Scene.ask``)."""
    answers = scene.ask(*phrases, most=1)
    for answer in answers:
        if answer.refusal:
            log(f"{answer.asked!r} is left out: {answer.refusal}")
    shown = [answer for answer in answers if answer.things]
    if not shown:
        raise UserError(f"{scene.folder}: no query has an answer to show")
    (first, *others), times = zip(*_pictures(scene, shown, side), strict=True)
    how = {"save_all": True, "duration": list(times), "loop": 0, "quality": 70, "method": 4}
    with atomic_file(output) as scratch:
        first.save(scratch, format="WEBP", append_images=others, **how)
    log(f"{output}: {len(times)} pictures, {output.stat().st_size / 1e6:.1f} MB")


def _pictures(scene: Scene, shown: Sequence[Answer], side: int) -> Iterator[tuple[Image.Image, int]]:
    """Pictures and the time of each [ms]: on the way to each answer, while it lights up, and the answer."""
    camera, turned = rendering_camera(scene.camera, side), lies_on_its_side(scene.artifact("frames"))

    def picture(painted: QueryScene, frame: int) -> Floats:
        rendered = painted.picture(camera, scene.poses[frame])
        return np.rot90(rendered, -1) if turned else rendered

    before, grading = shown[-1].things[0].frame, scene.grading()
    for answer in track(shown, "drawing answers", unit="answer"):
        thing = answer.things[0]
        for frame in way(scene.poses, before, thing.frame):
            yield _captioned(picture(scene.trained, frame), ""), _STEP_MS
        plain, lit = picture(scene.trained, thing.frame), picture(_lit(scene.trained, thing), thing.frame)
        said = f"best guess, {grading.measure}" if answer.grade == GUESS else grading.measure
        size = " x ".join(f"{length:.2f}" for length in thing.size)
        text = f'"{answer.asked}"   {size} {scene.unit}   {said} {grading.shown(answer.rating)}'
        for share in np.arange(1, _LIGHTS + 1) / _LIGHTS:
            mixed = (1 - share) * plain + share * lit
            yield _captioned(mixed, text), _ANSWER_MS if share == 1 else _STEP_MS
        before = thing.frame


def way(poses: Array, start: int, end: int) -> list[int]:
    """Frames with a pose on the recorded way from one frame to another, at most ``_STEPS``, without the first.

    Args:
        poses: (F, 4, 4) camera_to_world, NaN without a pose.
    """
    known = known_poses(poses)
    between = known[(known >= min(start, end)) & (known <= max(start, end))][:: 1 if start <= end else -1]
    return between[evenly_spaced(len(between), _STEPS + 1)][1:].tolist()


def _lit(scene: QueryScene, thing: Thing) -> QueryScene:
    """The scene with a thing in the color of heat, and all else dim and gray."""
    own = (scene.gaussians.sh[:, :1] * SH_C0 + 0.5).clamp(0.0, 1.0)
    gray = own.mean(dim=2, keepdim=True)
    colors = (_DIM * gray).expand_as(own).clone()
    hot = torch.tensor(_HOT, device=own.device) / 255
    colors[thing.members] = _STRENGTH * hot + (1 - _STRENGTH) * gray[thing.members]
    return replace(scene, gaussians=replace(scene.gaussians, sh=(colors - 0.5) / SH_C0), sh_degree=0)


def _captioned(rendered: Reals, text: str) -> Image.Image:
    """An image with a line of text below the picture, smaller for a long text."""
    height, width = rendered.shape[:2]
    line = round(_LINE * max(height, width))
    image = Image.new("RGB", (width, height + line), "black")
    image.paste(Image.fromarray((np.clip(rendered, 0, 1) * 255).round().astype(np.uint8)))
    draw, size = ImageDraw.Draw(image), 0.5 * line
    size *= min(1.0, 0.95 * width / max(1.0, draw.textlength(text, ImageFont.load_default(size))))
    font = ImageFont.load_default(max(6.0, size))
    draw.text((width / 2, height + line / 2), text, "white", font, anchor="mm")
    return image
