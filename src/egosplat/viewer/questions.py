"""Ask a scene in words, and name what is at a place."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.locating import locate
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.registry import SCHEMAS
from egosplat.errors import UserError
from egosplat.geometry import Array, Camera, make_pose
from egosplat.models.open_clip_loader import OpenClip
from egosplat.models.suitability import notice_of_artifacts
from egosplat.query.answer import pixel_position, view_of
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.scene import QueryScene, with_codes
from egosplat.query.scene_query import SceneAnswer, answer_from_relevancy
from egosplat.query.text import encode_texts, encoded_of, load_clip_of, untaught_words
from egosplat.query.things import Thing
from egosplat.query.vocabulary import words_to_try
from egosplat.viewer.prepared import Prepared, prepare
from egosplat.viewer.scene import ViewedScene

# Maximum number of things in an answer.
MOST_THINGS = 3

# Number of words that name a place, at each level.
MOST_WORDS = 3

# Side of the picture that a click draws [px], and its focal length [px]: the middle pixel covers 1/500 of the distance.
CLICK_SIDE, CLICK_FOCAL = 5, 500.0


@dataclass(frozen=True, eq=False)
class Reply:
    """The answer to a question about a whole scene.

    Attributes:
        answer: all that was found.
        things: what fits well enough, by decreasing score.
        refusal: why nothing fits, or None.
        fit: (L, N) float32 relevancy of each Gaussian, averaged over its neighbors.
    """

    answer: SceneAnswer
    things: tuple[Thing, ...]
    refusal: str | None
    fit: NDArray[np.float32]

    @property
    def level(self) -> int | None:
        """Level of the best thing, or None if nothing fits."""
        return self.things[0].level if self.things else None


@dataclass(frozen=True, eq=False)
class Named:
    """What is at a place.

    Attributes:
        position: (3,) float64 in the world, or None if nothing is there.
        words: the best words of each level with their relevancies.
    """

    position: Array | None
    words: tuple[tuple[tuple[str, float], ...], ...]


class Questions:
    """A scene that can be asked.

    Attributes:
        levels: names of the levels.
        options: how answers are computed.
        words: words to try.
        notice: what to keep in mind about the checkpoints that made the scene, or None.
    """

    def __init__(
        self,
        prepared: Prepared,
        clip: OpenClip,
        levels: Sequence[str],
        options: QueryOptions,
        notice: str | None = None,
    ) -> None:
        self.levels, self.options, self.notice = tuple(levels), options, notice
        self.words = words_to_try(clip)
        self._prepared, self._clip = prepared, clip
        self._texts = encode_texts(clip, self.words, options.canonical)

    @property
    def scene(self) -> QueryScene:
        """The scene with its codes."""
        return self._prepared.index.scene

    def ask(self, phrase: str) -> Reply:
        """Answer a query, as ``egosplat query`` does without a frame.

        Raises:
            UserError: see ``encode_phrases``.
        """
        index, options = self._prepared.index, self.options
        texts = encode_texts(self._clip, [phrase], options.canonical)
        [relevancy] = self._prepared.relevancy(texts, options.temperature)
        answer = answer_from_relevancy(index, phrase, relevancy, options, MOST_THINGS)
        refusal = answer.refusal(untaught_words(self._clip, phrase), options)
        smooth = (matrix @ values for matrix, values in zip(index.surface.averaging, relevancy, strict=True))
        things = () if refusal else answer.fitting(options)
        return Reply(answer, things, refusal, np.stack(list(smooth)).astype(np.float32))

    def best_frame(self, thing: Thing) -> int:
        """The frame that shows a thing best."""
        return self._prepared.index.best_frame(thing)

    @torch.inference_mode()
    def name(self, origin: Array, direction: Array) -> Named:
        """Name what a ray meets first.

        Args:
            origin: (3,) float64 in the world.
            direction: (3,) float64, of any length but 0.
        """
        camera, pose = ray_camera(origin, direction)
        view = view_of(self.scene, camera, pose, None, 0)
        middle = CLICK_SIDE // 2
        position = pixel_position(camera, pose, (middle, middle), view.depth.cpu().numpy())
        if position is None:
            return Named(None, ())
        seen = view.coverage > self.options.min_coverage
        fits = relevancy_maps(view.codes, seen, self.scene.decoder, self._texts, self.options.temperature)
        at_middle = fits[:, :, middle, middle].T.cpu().numpy()
        return Named(position, tuple(self._best_words(level) for level in at_middle))

    def _best_words(self, fits: NDArray[np.float32]) -> tuple[tuple[str, float], ...]:
        best = np.argsort(-fits, kind="stable")[:MOST_WORDS]
        known = (number for number in best if fits[number] >= self.options.min_score)
        return tuple((self.words[number], float(fits[number])) for number in known)


def ray_camera(origin: Array, direction: Array) -> tuple[Camera, Array]:
    """A camera of a few pixels whose middle pixel looks along a ray, and its (4, 4) pose."""
    forward = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    # Any axis that is not parallel to the ray gives the picture's sides.
    right = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    side, half = CLICK_SIDE, CLICK_SIDE / 2
    return Camera(side, side, CLICK_FOCAL, CLICK_FOCAL, half, half), make_pose(rotation, np.asarray(origin))


def open_questions(
    viewed: ViewedScene,
    options: QueryOptions,
    *,
    device: str,
    precision: str,
    cache: Path | None,
) -> Questions:
    """Open what a scene needs to answer questions.

    Args:
        device, precision: of OpenCLIP, as the keys of the section ``models``.
        cache: see ``prepare``.

    Raises:
        UserError: language.zarr, or the features.zarr or tiles.zarr that it was learnt from, is missing, damaged or made from another
            scene; or OpenCLIP is not the one that made the features.
    """
    language = _finished(viewed.folder, LANGUAGE.name)
    features = _finished(viewed.folder, encoded_of(language))
    check_made_from(language, features, viewed.splats, viewed.poses, viewed.frames)
    made_with = features.facts["clip"]
    clip = load_clip_of(features, made_with["model"], made_with["checkpoint"], device, precision)
    scene = with_codes(viewed.trained, language, features)
    sources = (viewed.frames, viewed.poses, viewed.splats, features, language)
    valid = viewed.frames.read("valid")
    prepared = prepare(scene, sources, viewed.camera_to_world, valid, cache)
    notice = notice_of_artifacts(lineage([language, features]).found.values())
    return Questions(prepared, clip, language.facts["levels"], options, notice)


def _finished(folder: Path, name: str) -> Artifact:
    """Open an artifact of a scene or variant; an error names the command that makes it."""
    (path,) = locate(folder, name)
    if not path.exists():
        raise UserError(f"{path}: does not exist; make it: snakemake --cores 2 {path}")
    return open_artifact(path, SCHEMAS[name])
