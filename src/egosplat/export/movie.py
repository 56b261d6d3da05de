"""A moving picture of a scene that is asked: the camera goes to each answer, and the answer lights up. ``egosplat movie``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from egosplat.artifacts.frames import lies_on_its_side
from egosplat.artifacts.poses import length_unit
from egosplat.artifacts.splats import camera_poses
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.gaussians.initialization import SH_C0
from egosplat.geometry import Array, known_poses
from egosplat.images import evenly_spaced
from egosplat.progress import log, track
from egosplat.query.answer import rendering_camera
from egosplat.query.command import open_question, open_sources
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene
from egosplat.query.scene_query import SceneAnswer, ask_scene, index_scene
from egosplat.query.sources import QuerySources
from egosplat.query.things import Thing

# Views on the way to an answer and time of each [ms].
_STEPS, _STEP_MS = 16, 90

# Steps in which an answer lights up, and time of its last picture [ms].
_LIGHTS, _ANSWER_MS = 4, 1800

# Height of the line of text, relative to the longer side of the picture.
_LINE = 0.085

_QUALITY = 70

# Color of an answer: a red of the color map Turbo, and its share in a Gaussian; the rest is the Gaussian's own brightness.
_HOT, _STRENGTH = (195.0, 37.0, 3.0), 0.75

# Brightness of all else, relative to its own.
_DIM = 0.6

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Shown:
    """An answer to show.

    Attributes:
        text: what the picture says of it.
        frame: the frame that shows it best.
    """

    text: str
    thing: Thing
    frame: int


def run(
    folder: Path,
    phrases: Sequence[str],
    output: Path,
    side: int,
    options: QueryOptions,
    *,
    backend: str,
    device: str,
    precision: str,
) -> None:
    """Ask a scene, and write a moving picture of the answers.

    Args:
        folder: folder with the artifacts of a scene.
        phrases: the queries, at least one. Those without an answer are left out.
        output: .webp file to write.
        side: longer side of the picture [px].
        options: how queries are answered.
        backend: renderer, as the key ``backend``.
        device, precision: of OpenCLIP, as the keys of the section ``models``.

    Raises:
        UserError: no query has an answer, an artifact is missing, damaged or does not belong to the others.
    """
    sources, _ = open_sources(folder)
    question = open_question(sources, phrases, options, backend=backend, device=device, precision=precision)
    scene, poses = question.scene, camera_poses(sources.poses, sources.splats)
    index = index_scene(scene, poses, scene.camera, sources.frames.read("valid"))
    shown = []
    for answer in ask_scene(index, question.texts, options, most=1):
        if why := answer.refusal(question.untaught[answer.phrase], options):
            log(f"{answer.phrase!r} is left out: {why}")
        else:
            thing = answer.things[0]
            shown.append(Shown(_text(answer, sources), thing, index.best_frame(thing)))
    if not shown:
        raise UserError(f"{folder}: no query has an answer to show")
    turned = lies_on_its_side(sources.frames)
    pictures, times = zip(*_pictures(scene, poses, shown, side, turned), strict=True)
    _write(output, pictures, times)
    log(f"{output}: {len(pictures)} pictures, {output.stat().st_size / 1e6:.1f} MB")


def _text(answer: SceneAnswer, sources: QuerySources) -> str:
    thing = answer.things[0]
    size = " x ".join(f"{side:.2f}" for side in thing.high - thing.low)
    return f'"{answer.phrase}"   {size} {length_unit(sources.poses)}   score {answer.score:.2f}'


def _pictures(
    scene: QueryScene, poses: Array, shown: Sequence[Shown], side: int, turned: bool
) -> Iterator[tuple[Image.Image, int]]:
    """Pictures and the time of each [ms]: on the way to an answer, while it lights up, and the answer."""
    camera = rendering_camera(scene.camera, side)

    def picture(painted: QueryScene, frame: int) -> NDArray[np.float32]:
        rendered = painted.picture(camera, poses[frame])
        return np.rot90(rendered, -1) if turned else rendered

    before = shown[-1].frame
    for one in track(shown, "drawing answers", unit="answer"):
        for frame in way(poses, before, one.frame):
            yield _captioned(picture(scene, frame), ""), _STEP_MS
        plain, lit = picture(scene, one.frame), picture(_lit(scene, one.thing), one.frame)
        for step in range(1, _LIGHTS + 1):
            share = step / _LIGHTS
            mixed = (1 - share) * plain + share * lit
            yield _captioned(mixed, one.text), _ANSWER_MS if step == _LIGHTS else _STEP_MS
        before = one.frame


def way(poses: Array, start: int, end: int) -> list[int]:
    """Frames with a pose on the recorded way from one frame to another, at most ``_STEPS``, without the first.

    Args:
        poses: (F, 4, 4) camera_to_world, NaN without a pose.
    """
    known = known_poses(poses)
    between = known[(known >= min(start, end)) & (known <= max(start, end))]
    ordered = between if start <= end else between[::-1]
    return [int(frame) for frame in ordered[evenly_spaced(len(ordered), _STEPS + 1)][1:]]


def _lit(scene: QueryScene, thing: Thing) -> QueryScene:
    """The scene with a thing in the color of heat, and all else dim and gray."""
    own = (scene.gaussians.sh[:, :1] * SH_C0 + 0.5).clamp(0.0, 1.0)
    gray = own.mean(dim=2, keepdim=True)
    colors = (_DIM * gray).expand_as(own).clone()
    hot = torch.tensor(_HOT, device=own.device) / 255
    colors[thing.members] = _STRENGTH * hot + (1 - _STRENGTH) * gray[thing.members]
    return replace(scene, gaussians=replace(scene.gaussians, sh=(colors - 0.5) / SH_C0), sh_degree=0)


def _captioned(rendered: NDArray[np.float32], text: str) -> Image.Image:
    """An image with a line of text below the picture."""
    height, width = rendered.shape[:2]
    line = round(_LINE * max(height, width))
    image = Image.new("RGB", (width, height + line), "black")
    image.paste(Image.fromarray((np.clip(rendered, 0, 1) * 255).round().astype(np.uint8)))
    draw = ImageDraw.Draw(image)
    size = 0.5 * line
    # A long query is written smaller.
    size *= min(1.0, 0.95 * width / max(1.0, draw.textlength(text, ImageFont.load_default(size))))
    font = ImageFont.load_default(max(6.0, size))
    draw.text((width / 2, height + line / 2), text, "white", font, anchor="mm")
    return image


def _write(output: Path, pictures: Sequence[Image.Image], times: Sequence[int]) -> None:
    first, *others = pictures
    with atomic_file(output) as scratch, scratch.open("wb") as file:
        first.save(
            file,
            format="WEBP",
            save_all=True,
            append_images=others,
            duration=list(times),
            loop=0,
            quality=_QUALITY,
            method=4,
        )
