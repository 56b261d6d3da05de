"""Ask scenes by a picture of a thing, or by a name that was given to one by hand (docs/look.md#pictures)."""

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from egosplat.arrays import Array, Bytes, Ints
from egosplat.artifacts.schemas import lies_on_its_side
from egosplat.errors import UserError
from egosplat.features.crops import encode_crops
from egosplat.files import atomic_file, read_json, write_text
from egosplat.frames.images import read_rgb
from egosplat.histories.told import clock
from egosplat.images import resize_image
from egosplat.models.clip import OpenClip
from egosplat.pipeline.home import NAMES
from egosplat.query.answers import Answer, Thing
from egosplat.query.command import align_rows, show_point, show_size
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import Grading, judge
from egosplat.query.options import MOST
from egosplat.query.reading import strip_asking
from egosplat.query.text import clean_phrase
from egosplat.query.things import EXTENT, SAME

# Grades of the things that are like a picture (benchmarks/visual_queries).
_UNLIKE = "not found: no thing here looks like it (the most alike has a similarity of {})"
SIMILARITY = Grading("similarity", 0.9, 0.86, "", _UNLIKE)

# What is in the middle of a picture, by these shares of its sides, is compared, too: it may show more than its thing.
_MIDDLES = (1.0, 0.87, 0.77)

# Views of a thing that count, those most like a picture: others show it from behind. Views that a name keeps.
_BEST, _KEPT = 3, 8

# Things that are compared with a picture once more, by crops with what surrounds them; and views of each.
_AGAIN, _VIEWS_AGAIN = 16, 6

# Smallest side of a picture, and height of those that are drawn [px].
_LEAST_SIDE, _DRAWN = 12, 256


@dataclass(frozen=True, eq=False)
class Alike(Thing):
    """A thing of a scene that may be what a picture shows; its score is the mean cosine of its best views with the picture.

    Attributes:
        members, center, size: as of any thing, of an instance, by the Gaussians of instances.zarr; none and NaN of what moves.
        instance: its number in instances.zarr.
        frame, box: the view most like the picture, and x0, y0, x1, y1 around the thing there, the ends exclusive [px].
        last_s: when it was seen last, by training frames [s since the first frame].
    """

    instance: int = -1
    box: tuple[int, ...] = ()
    last_s: float = 0.0


class Looks:
    """What the things of a scene look like: V views of instances, with their features."""

    def __init__(self, scene: Scene) -> None:
        """Read them (UserError: the scene has none, or they are damaged or of another scene)."""
        self.scene, views, things = scene, scene.artifact("view_features"), scene.artifact("instances")
        names = ("instance", "frame", "box", "area")
        self.instance, self.frame, self.box, self.area = map(views.read, names)
        self.feature = views.read("feature").astype(np.float64)
        self.level, self.owner = things.read("instances/level"), things.read("gaussians/instance")
        self._levels = things.facts["levels"]
        self._xyz = things.read("gaussians/xyz").astype(np.float64)

    def find(self, asked: Array, most: int, pictured: bool = False, but: Alike | None = None) -> list[Alike]:
        """At most ``most`` things by decreasing similarity to any of (Q, D) features of unit norm, ``but`` for one; of those that overlap,
        the best. With what surrounds them, if they are ``pictured``."""
        every = np.arange(len(self.frame))
        fits = (self.feature @ asked.T).max(axis=1, initial=-1.0)
        ranked = self._ranked(every, fits)
        if pictured and ranked:
            every = np.concatenate([rows[:_VIEWS_AGAIN] for _, rows in ranked[:_AGAIN]])
            views = zip(self.frame[every].tolist(), self.box[every].tolist(), strict=True)
            frames, turns = self.scene.frames, -int(lies_on_its_side(self.scene.artifact("frames")))
            crops = [np.rot90(frames[at][y0:y1, x0:x1], turns) for at, (x0, y0, x1, y1) in views]
            fits[every] = (_encode(self.scene.clip, crops) @ asked.T).max(axis=1)
            ranked = self._ranked(every, fits)
        kept = [but] if but else []
        for similarity, rows in ranked:
            if len(kept) == most + bool(but):
                break
            thing = self._thing(similarity, rows)
            if not any(self._is_one(thing, other) for other in kept):
                kept.append(thing)
        return kept[bool(but) :]

    def _ranked(self, rows: Ints, fits: Array) -> list[tuple[float, Ints]]:
        """The similarity of each thing with some of the ``rows``, and its own, the most alike first; by decreasing similarity."""
        rows = rows[np.lexsort((-fits[rows], self.instance[rows]))]
        things = np.split(rows, np.flatnonzero(np.diff(self.instance[rows])) + 1) if len(rows) else []
        return sorted(((float(fits[own[:_BEST]].mean()), own) for own in things), key=lambda one: -one[0])

    def _thing(self, similarity: float, rows: Ints) -> Alike:
        number, best = int(self.instance[rows[0]]), rows[0]
        members = np.flatnonzero(self.owner[:, self.level[number]] == number)
        places = self._xyz[members] if len(members) else np.full((1, 3), np.nan)
        low, center, high = np.quantile(places, (EXTENT[0], 0.5, EXTENT[1]), axis=0)
        last_s = float(self.scene.seconds[self.frame[self.instance == number].max()])
        level, share = self._levels[self.level[number]], float(self.area[best] / self.scene.valid.size)
        place = level, center, high - low, int(self.frame[best]), members, share
        box = tuple(self.box[best].tolist())
        return Alike(similarity, *place, instance=number, box=box, last_s=last_s)

    def _is_one(self, thing: Alike, other: Alike) -> bool:
        """Whether two things share Gaussians; of what moves and has none, whether frames show both at one place."""
        if least := min(len(thing.members), len(other.members)):
            return bool(np.isin(thing.members, other.members).sum() > SAME * least)
        rows, others = (np.flatnonzero(self.instance == one.instance) for one in (thing, other))
        _, one, two = np.intersect1d(self.frame[rows], self.frame[others], return_indices=True)
        boxes = self.box[rows[one]], self.box[others[two]]
        sides = np.minimum(*boxes)[:, 2:] - np.maximum(*boxes)[:, :2]
        areas = [(box[:, 2:] - box[:, :2]).prod(axis=1) for box in boxes]
        return bool((sides.clip(0).prod(axis=1) > SAME * np.maximum(*areas)).any())

    def thing(self, number: int) -> tuple[Alike, Array]:
        """An instance, and (Q, D) features of some of its views (UserError: it has none)."""
        rows = np.flatnonzero(self.instance == number)
        if not len(rows):
            raise UserError("the recording has no picture of this thing alone: click another one")
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), _KEPT)).astype(int)]
        return self._thing(1.0, rows), self.feature[some]

    def called(self, name: str, known: Mapping[str, Any]) -> Array:
        """(Q, D) features of what has one of the ``known`` names (UserError: another OpenCLIP made them)."""
        if known[name]["clip"] != self.scene.encoded.facts["clip"]["hash"]:
            raise UserError(f"{name!r}: was named with another OpenCLIP; name it in a scene of this one")
        return np.array(known[name]["features"])

    def named(self, thing: str) -> Alike:
        """The thing in 3D at a place, as an answer prints it, or that a word finds (UserError: none is there, or is found)."""
        if re.fullmatch(r"\s*-?\d*\.?\d+(\s*,\s*-?\d*\.?\d+){2}\s*", thing):
            center = np.array([float(number) for number in thing.split(",")])
        else:
            answer, *more = self.scene.ask(thing, most=1)
            if more or not answer.things:
                why = f"asks for {1 + len(more)} things" if more else answer.refusal
                raise UserError(f"{thing!r}: {why}\nGive a place that an answer prints, or another word")
            center = answer.things[0].center
        every = (self.thing(number)[0] for number in np.unique(self.instance).tolist())
        solid = [one for one in every if len(one.members)]
        near = min(solid, key=lambda one: np.linalg.norm(one.center - center), default=None)
        if near is None or np.linalg.norm(near.center - center) > near.size.max():
            raise UserError(f"{thing}: no thing is there; give a place that an answer prints, or a word")
        return near


def read_picture(path: Path) -> Bytes:
    """(H, W, 3) uint8 of a picture of a thing (UserError: it is none, or too small)."""
    picture = read_rgb(path)
    height, width = picture.shape[:2]
    if min(height, width) < _LEAST_SIDE:
        raise UserError(f"{path}: {width}x{height} px; give a picture with {_LEAST_SIDE} px a side or more")
    return picture


def see(clip: OpenClip, picture: Bytes) -> Array:
    """(Q, D) features of an (H, W, 3) picture of a thing, and of what is in its middle."""
    sides = np.array(picture.shape[:2])
    cuts = [((1 - share) / 2 * sides).astype(int) for share in _MIDDLES]
    return _encode(clip, [picture[top : sides[0] - top, left : sides[1] - left] for top, left in cuts])


def _encode(clip: OpenClip, crops: Sequence[Bytes]) -> Array:
    return np.nan_to_num(encode_crops(clip, crops)).astype(np.float64)


def give_name(scene: Scene, thing: str | int, name: str) -> Alike:
    """Keep a name for an instance, or for the thing at a place, or that a word finds, beside the scene. Raises as ``Looks.named``."""
    if not (key := clean_phrase(name).lower()):
        raise UserError("name: is blank; give one or more words")
    looks, path = Looks(scene), scene.folder / NAMES
    named, kept = looks.thing(thing if isinstance(thing, int) else looks.named(thing).instance)
    entry = {"clip": scene.encoded.facts["clip"]["hash"], "features": kept.round(4).tolist()}
    write_text(path, json.dumps(read_names(path) | {key: entry}))
    return named


def read_names(path: Path) -> dict[str, Any]:
    """The names in a file, or in that of a scene's folder; none without one (UserError: it is no such file)."""
    path = path / NAMES if path.is_dir() else path
    try:
        names = read_json(path) if path.name != NAMES or path.exists() else {}
        return {name: {key: one[key] for key in ("clip", "features")} for name, one in names.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        advice = "remove it" if path.name == NAMES else "give the folder of a scene"
        raise UserError(f"{path}: is no file of names ({error}); {advice}") from None


def find_name(text: str, known: Collection[str]) -> str | None:
    """The known name that a text is, or asks for, as "where is my mug?" does."""
    asked = clean_phrase(text).lower()
    alike = (name for name in known if name in asked and strip_asking(name) == strip_asking(asked))
    return asked if asked in known else next(alike, None)


def run(
    scenes: Sequence[Scene], pictures: Sequence[Path], names: Mapping[str, Any], most: int, output: Path
) -> Iterator[str]:
    """Ask each of some scenes for what pictures show and what names mean, by ``most`` things each; ``names`` as of ``read_names``.

    Yields tables, then lines about the drawing (UserError: as ``read_picture``; or a name was given by another OpenCLIP).
    """
    shown = {str(path): read_picture(path) for path in pictures}
    drawn, best = [], {}
    for scene in scenes:
        head = f"like,answer,similarity,lead,center [{scene.unit}],size [{scene.unit}],frame,last seen"
        rows = [tuple(head.split(","))]
        for answer, things in ask_looks(scene, shown, names, most):
            asked = answer.phrase
            rows += _rows(answer, things)
            drawn.append((shown.get(asked), scene, things[:most]))
            if things and things[0].score > best.get(asked, (0.0, ""))[0]:
                best[asked] = things[0].score, f"{scene.folder}, last seen at {clock(things[0].last_s)}"
        yield f"{scene.folder}, the whole scene, origin {scene.origin}\n{align_rows(rows)}\n"
    if scenes[1:]:
        yield "\n".join(f"{asked}: most alike in {where}" for asked, (_, where) in best.items())
    with atomic_file(output) as file:
        Image.fromarray(_draw(drawn)).save(file, format="PNG")
    yield f"picture: {output}"


def ask_looks(
    scene: Scene, shown: Mapping[str, Bytes], names: Mapping[str, Any], most: int
) -> Iterator[tuple[Answer, list[Alike]]]:
    """Answer what pictures show and what names mean; with the things compared, the most alike first. Raises as ``run``."""
    looks = Looks(scene)
    for asked in (*shown, *names):
        wanted = see(scene.clip, shown[asked]) if asked in shown else looks.called(asked, names)
        things = looks.find(wanted, max(2, most), asked in shown)
        yield judge(asked, things, ((), None), SIMILARITY, most), things


def ask_pictures(scene: Scene, *pictures: Path | str, most: int = MOST) -> list[Answer]:
    """Answer what each picture shows by at most ``most`` things of the whole scene that look like it. Raises as ``run``."""
    shown = {str(path): read_picture(Path(path)) for path in pictures}
    return [answer for answer, _ in ask_looks(scene, shown, {}, most)]


def _rows(answer: Answer, things: Sequence[Alike]) -> list[tuple[str, ...]]:
    lead = f"{things[0].score - things[1].score:+.2f}" if things[1:] else "-"
    rows: list[tuple[str, ...]] = [(answer.phrase, answer.refusal)] if answer.refusal else []
    for one in things[: len(answer.things)]:
        size = show_size(one.size) if len(one.members) else "moves"
        told = show_point(one.center), size, str(one.frame), clock(one.last_s)
        name, ahead = ("", "") if rows else (answer.phrase, lead)
        rows.append((name, answer.grade, SIMILARITY.shown(one.score), ahead, *told))
    return rows


def _draw(answers: Sequence[tuple[Bytes | None, Scene, Sequence[Alike]]]) -> Bytes:
    """A row for each answer: the picture, then the frame most like it of each thing, with its box."""
    rows = []
    for picture, scene, things in answers:
        tiles = [] if picture is None else [picture]
        for thing in things:
            tiles.append(scene.frames[thing.frame].copy())
            cv2.rectangle(tiles[-1], thing.box[:2], thing.box[2:], (255, 255, 0), 4)
        tiles = [resize_image(one, max(1, _DRAWN * one.shape[1] // one.shape[0]), _DRAWN) for one in tiles]
        rows.append(np.hstack([*tiles, np.zeros((_DRAWN, 1, 3), np.uint8)]))
    width = max(row.shape[1] for row in rows)
    return np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows])
