"""A finished scene as one object: open it, ask it, render it (docs/python.md)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.arrays import Array, Bools, Bytes, Floats, Ints, Ints32
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.integrity import digest_of
from egosplat.artifacts.lineage import Lineage, lineage, locate, open_histories
from egosplat.artifacts.reader import Artifact, open_artifact, verify
from egosplat.artifacts.schemas import SCHEMAS, camera_poses, length_unit, seconds_of
from egosplat.errors import UserError, read_whole
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera, known_poses
from egosplat.histories.known import Histories, Rests
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_clip_of
from egosplat.pipeline.home import ASKED, check_scene_folder
from egosplat.pipeline.shared_options import ClipOptions
from egosplat.query import grades
from egosplat.query.answers import Answer, Moving, Thing, ViewMatch
from egosplat.query.contest import Contest, leads_of
from egosplat.query.maps import innermost
from egosplat.query.moving import Tracks
from egosplat.query.options import MOST, AskingOptions, QueryOptions
from egosplat.query.reading import Question, read_questions
from egosplat.query.relations import Space, relate
from egosplat.query.scene import Pose, QueryScene, Viewpoint, instances_of_gaussians, read_scene
from egosplat.query.sizes import Sizes, estimate_unit, log_ratios
from egosplat.query.text import Texts, encode_texts, explain_untaught, words_to_try
from egosplat.query.things import Surface, ask_scene, measure_extents, read_surface
from egosplat.query.views import Asker, show_thing

# What OpenCLIP encoded for a scene's codes, and an array of it: the features of instances, or tiles for methods without masks.
ENCODED = {"features": "consistent", "tiles": "scale/0"}

# Things that are compared where a question tells how they stand.
_MANY = 8


@dataclass(frozen=True)
class Frames:
    """The rectified frames of a scene's recording, (H, W, 3) uint8 sRGB each, read one at a time."""

    artifact: Artifact

    def __len__(self) -> int:
        return self.artifact.shape("rgb")[0]

    def __getitem__(self, frame: int) -> Bytes:
        if not 0 <= (frame := read_whole("frame", frame)) < len(self):
            raise IndexError(frame)
        return self.artifact.row("rgb", frame)


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A finished scene or variant, made by ``egosplat.open_scene``; nothing large is read before it is needed, nothing is written.

    ``given`` are the opened artifacts, ``made_from`` also what they were made from; bytes of ``checked`` ones are as their digests tell.
    """

    folder: Path
    given: tuple[Artifact, ...]
    made_from: Lineage
    options: AskingOptions
    checked: bool = True

    def __repr__(self) -> str:
        return f"Scene({str(self.folder)!r})"

    def artifact(self, name: str) -> Artifact:
        """Get an artifact of the scene by its name, such as ``poses`` (UserError: it is not there, or belongs to another)."""
        for artifact in (*self.given, *self.made_from.found.values()):
            if artifact.schema.name == name:
                return artifact
        if name not in SCHEMAS:
            raise UserError(f"{name!r} is no artifact; there are {', '.join(SCHEMAS)}")
        artifact = open_artifact(self.folder / f"{name}.zarr", SCHEMAS[name])
        check_made_from(artifact, *self.given)
        return artifact

    @property
    def encoded(self) -> Artifact:
        """The features of the scene, or the tiles that its codes were learnt from."""
        return next(one for one in self.given if one.schema.name in ENCODED)

    @property
    def levels(self) -> list[str]:
        """Names of the levels of detail, from fine to coarse."""
        return self.artifact("language").facts["levels"]

    @property
    def unit(self) -> str:
        """Unit of lengths: ``m``, or ``scene units`` if the scale is arbitrary."""
        return length_unit(self.artifact("poses"))

    @property
    def origin(self) -> str:
        """``real`` or ``synthetic``."""
        return self.artifact("language").origin

    @property
    def camera(self) -> Camera:
        """The camera of all frames."""
        return Camera(**self.artifact("splats").facts["camera"])

    @property
    def frames(self) -> Frames:
        """The frames of the recording."""
        return Frames(self.artifact("frames"))

    @cached_property
    def poses(self) -> Array:
        """(F, 4, 4) float64 camera_to_world of the frames, OpenCV axes; NaN without a pose."""
        return camera_poses(self.artifact("poses"), self.artifact("splats"))

    @cached_property
    def valid(self) -> Bools:
        """(H, W) bool pixels of the frames that show the scene."""
        return self.artifact("frames").read("valid")

    @cached_property
    def seconds(self) -> Array:
        """(F,) float64 time of each frame since the first [s]."""
        return seconds_of(self.artifact("frames"))

    @property
    def gaussians(self) -> Gaussians:
        """The N trained Gaussians."""
        return self.trained.gaussians

    @cached_property
    def instances(self) -> Ints32:
        """(L, N) int32 instance of each Gaussian at each level of the codes, -1 for none. Raises as ``instances_of_gaussians``."""
        names = (instances := self.artifact("instances")).facts["levels"]
        # A level without an instance has no codes; codes of all levels in one get the coarsest.
        rows = [names.index(level) if level in names else -1 for level in self.levels]
        return instances_of_gaussians(instances, self.trained.gaussians.means.cpu().numpy())[rows]

    @cached_property
    def rests(self) -> Rests | None:
        """What lies somewhere for a while, on the device of the renderer; None if it is not known."""
        tracked = self._tracked
        return tracked and Rests.read(tracked, self.seconds, self.gaussians.means.device)

    @cached_property
    def histories(self) -> Histories | None:
        """What is carried from where to where; None if histories.zarr is not there, or is of other Gaussians or another OpenCLIP."""
        if (tracked := self._tracked) is None or (rests := self.rests) is None:
            return None
        # Features of another OpenCLIP compare with no word.
        channels = self.encoded.shape(ENCODED[self.encoded.schema.name])[-1]
        return Histories(tracked, rests, self.seconds) if rests.feature.shape[1] == channels else None

    @cached_property
    def tracks(self) -> Tracks | None:
        """What moves and is masked from the Gaussians; None if nothing is."""
        masks, views = (self.made_from.found.get(f"{name}.zarr") for name in ("masks", "view_features"))
        if masks is None or views is None:
            return None
        return Tracks.read(masks, views, self.encoded, self.camera, self.poses, self.valid)

    @cached_property
    def _tracked(self) -> Artifact | None:
        # A stage is given what it may show: histories.zarr in the folder may be no input of it.
        given = next((one for one in self.given if one.schema.name == "histories"), None)
        return given if self.checked else open_histories(self.folder, self.artifact("splats"))

    @cached_property
    def trained(self) -> QueryScene:
        """The Gaussians with their codes, on the device of the renderer."""
        for artifact in () if self.checked else self.given:
            # Frames are not compared: they may hold gigabytes, and queries read only little of them. Reading checks numbers.
            if artifact.schema.name != "frames" and digest_of(artifact.path) != artifact.digest:
                verify(artifact.path, SCHEMAS)
        splats, language = self.artifact("splats"), self.artifact("language")
        return read_scene(splats, language, self.encoded, self.options.backend)

    @cached_property
    def clip(self) -> OpenClip:
        """The OpenCLIP that made the features."""
        how, made_with = self.options, self.encoded.facts["clip"]
        # A stage is told where OpenCLIP is: its files may have moved since they made the features.
        told = (how.clip_model, how.clip_checkpoint) if isinstance(how, ClipOptions) else None
        files = told or (made_with["model"], made_with["checkpoint"])
        return load_clip_of(self.encoded, *files, how.device, how.precision)

    @cached_property
    def surface(self) -> Surface:
        """What the frames show of each Gaussian; measured once for all queries of the whole scene."""
        assert len(self._posed)
        surface = read_surface(self.trained, self.poses, self.camera, self.valid)
        return replace(surface, instance=self.instances[-1]) if self._placed else surface

    @property
    def _placed(self) -> bool:
        """Whether the codes are of instances with a place in 3D."""
        made = self.made_from.found.get("instances.zarr")
        return made is not None and made.shape("gaussians/xyz")[0] > 0

    @cached_property
    def asked(self) -> QueryScene:
        """The Gaussians with the sizes of instances, where these have a place in 3D and the scale is known, or told by them."""
        if not self._placed or (self.unit != "m" and self.ruler is None):
            return self.trained
        ratios = log_ratios(self._extents * (self.ruler[0] if self.ruler else 1.0))
        of_gaussians = torch.from_numpy(self.instances.T.astype(np.int64)).to(self.trained.code.device)
        return replace(self.trained, sizes=Sizes(of_gaussians, ratios))

    @cached_property
    def ruler(self) -> tuple[float, float] | None:
        """The scene's unit [m] as the sizes of things tell it, and its spread [log]; None where it is known, or they do not tell."""
        if not self._placed or self.unit == "m" or not self._words.phrases:
            return None
        known = (self.instances >= 0) & (self.trained.share.T > 0).cpu().numpy()
        owner, batches = self.instances[known], self._words.in_batches(known.size)
        every = (self.trained.relevancy(words, self.options).cpu().numpy() for words in batches)
        fits = (fit[known] for some in every for fit in some)
        count, *sums = (np.bincount(owner, each, len(self._extents)) for each in chain([None], fits))
        odds = np.vectorize(grades.log_odds, otypes=[float])(np.stack(sums) / np.maximum(count, 1))
        return estimate_unit(self._extents, self._words.phrases, odds)

    @cached_property
    def _extents(self) -> Array:
        """(I, 5) extents of instances, see ``measure_extents``."""
        given = self.surface.means, self.instances, self.surface.touching, self.artifact("poses").read("up")
        return measure_extents(*given)

    @cached_property
    def _posed(self) -> Ints:
        """Frames with a pose, at least one."""
        if not len(posed := known_poses(self.poses)):
            path = self.artifact("poses").path
            raise UserError(f"{path}: no frame has a pose; see the log of the stage poses")
        return posed

    def ask(
        self,
        *phrases: str,
        most: int = MOST,
        frame: int | None = None,
        pose: Pose | None = None,
        second: float | None = None,
        **keys: Any,
    ) -> list[Answer]:
        """Answer questions, each once and in their order, in the whole scene, or in one view (docs/look.md#questions).

        Args:
            most: maximum number of things in an answer of the whole scene.
            frame, pose: ask only the view of this frame at its time, or of (4, 4) camera_to_world, or a JSON file that holds
            it. second: time of the pose [s since the first frame]: what lies somewhere for a while is seen at its time. keys:
            keys of the section ``query`` that differ from the scene's, such as ``min_score=0.6``.

        UserError: the OpenCLIP of the features is missing, the view has no pose, or a key is not valid."""
        options = self.options.change_keys(**keys)
        most = read_whole("most", most, 1)
        return list(self.reply(self.read(phrases), most, self.viewpoint(frame, pose, second), options))

    def read(self, texts: Iterable[str]) -> list[Question]:
        """Read texts as questions, each once."""
        names, texts = words_to_try(self.clip), list(texts)
        if others := [one for one in texts if not isinstance(one, str)]:
            raise UserError(f"a query is a text, not {others[0]!r:.40}")
        return list(dict.fromkeys(one for text in texts for one in read_questions(self.clip, text, names)))

    def reply(
        self,
        questions: Sequence[Question],
        most: int = MOST,
        viewpoint: Viewpoint | None = None,
        options: QueryOptions | None = None,
    ) -> Iterator[Answer]:
        """Answer questions one at a time, each once, or with an answer for each name where anything is asked for. Raises as ``ask``."""
        options = options or self.options
        answers = self.answers([one.phrase for one in questions if one.is_plain], most, viewpoint, options)
        for question in questions:
            if question.is_plain:
                yield replace(next(answers), question=question)
            elif question.refusal or viewpoint is not None:
                why = question.refusal or "needs the whole scene: leave out the view"
                yield Answer(question.phrase, grades.NOT_ASKED, 0.0, refusal=why, question=question)
            else:
                for answer in self._stand(question, options):
                    asked = replace(question, phrase=answer.phrase)
                    yield replace(answer, things=answer.things[:most], question=asked)

    def _stand(self, question: Question, options: QueryOptions) -> Iterator[Answer]:
        """Answer a question with all things that are found or guessed and stand as it asks."""
        anchors = [next(self._stand(one, options)) for one in question.anchors]
        words = [question.phrase] if question.phrase else self._words.phrases
        answers = self.answers(words, _MANY if question.phrase else MOST, None, options)
        space = Space(self.surface, self.artifact("poses").read("up"), self.poses)
        yield from relate(question, answers, anchors, self.grading(options), space)

    def answers(
        self,
        phrases: Iterable[str],
        most: int = MOST,
        viewpoint: Viewpoint | None = None,
        options: QueryOptions | None = None,
    ) -> Iterator[Answer]:
        """Answer queries one at a time, because answers in a view hold maps of its size; otherwise as ``ask``."""
        options = options or self.options
        # Only the answers are computed one by one: everything else is read before the first is asked for.
        texts = self.encode(phrases, options)
        if viewpoint is None:
            if self.trained.maps_only:
                raise UserError(f"{self.folder}: its codes answer single views alone, as with --frame 0")
            # The evidence for the best thing needs the next one.
            many = max(_MANY if self.contest else 2, most)
            every = ask_scene(self.asked, self.surface, texts, options, many)
            rows = zip(texts.phrases, every, strict=True)
            return (self._judged(texts.of([phrase]), things, most, options) for phrase, things in rows)
        if not texts.phrases:
            return iter(())
        matches = Asker(self.asked, texts, options, self.rests).ask(texts.phrases, self.camera, viewpoint)
        grading = grades.by_score(options.min_score)
        return (grades.judge_view(one, self._unknown(texts.of([one.phrase])), grading) for one in matches)

    def _unknown(self, query: Texts) -> grades.Unknown:
        """Words of one query that are not known, and what is told of them, or that other words win in the scene."""
        untaught, refusal = explain_untaught(self.clip, *query.phrases)
        if refusal is None and self.contest and self.contest.best(query) < grades.AMONG_WORDS.found:
            refusal = grades.AMONG_WORDS.below
        return untaught, refusal

    def _judged(self, query: Texts, things: Sequence[Thing], most: int, options: QueryOptions) -> Answer:
        """The verdict on the things that match one query best, with what is known of where it was carried."""
        [phrase], grading = query.phrases, self.grading(options)
        if self.contest:
            things = self.contest.rate(query, things, options.min_score)
        fit = grading.calibration
        leads = leads_of(self.trained, things, query, self._words, options)
        pairs = zip(things, grades.measure_evidence(things, leads, self.levels), strict=True)
        things = [replace(one, evidence=own, probability=fit and fit.probability(own)) for one, own in pairs]
        coded = bool(things) or bool((self.trained.share > 0).any())
        answer = grades.judge(phrase, things, explain_untaught(self.clip, phrase), grading, most, coded)
        if self.histories is not None and not answer.untaught:
            compared = self.histories, query, self._words, options.temperature
            answer = replace(answer, history=grades.find_history(*compared))
        if answer.grade == grades.FOUND or answer.untaught or self.tracks is None:
            return answer
        moving = self.tracks.find(query, self._words, self.seconds, grading, options)
        if moving is None:
            return answer
        refusal = f"seen moving {moving.told}, with no place in 3D"
        return replace(answer, grade=grades.MOVING, refusal=refusal, things=(), moving=moving)

    def encode(self, phrases: Iterable[str], options: QueryOptions | None = None) -> Texts:
        """Encode phrases, each once, and the canonical phrases. Raises as ``ask``."""
        return encode_texts(self.clip, list(dict.fromkeys(phrases)), options or self.options)

    def asker(self, phrases: Iterable[str]) -> Asker:
        """Encode phrases to ask them of many views, and compare them with the Gaussians once. Raises as ``ask``."""
        return Asker(self.asked, self.encode(phrases), self.options, self.rests)

    def viewpoint(
        self, frame: int | None = None, pose: Pose | None = None, second: float | None = None
    ) -> Viewpoint | None:
        """The view of a frame at its time, or of a pose at a time; None without either. Raises as ``ask``."""
        if frame is not None and pose is not None:
            raise UserError("frame and pose: give one of them")
        if second is not None and pose is None:
            what = "is the time of a pose; a frame has its own, and Answer.at is for the whole scene"
            raise UserError(f"second: {what}")
        if pose is not None:
            return Viewpoint.read(pose, second)
        if frame is None:
            return None
        count = len(self.poses)
        if not 0 <= (frame := read_whole("frame", frame)) < count:
            raise UserError(f"frame {frame}: there are {count} frames, 0 to {count - 1}")
        nearest = self._posed[np.abs(self._posed - frame).argmin()]
        if nearest != frame:
            raise UserError(f"frame {frame}: has no pose; the nearest frame with a pose is {nearest}")
        return Viewpoint(f"frame {frame}", self.poses[frame], self.valid, float(self.seconds[frame]))

    def render(
        self,
        frame: int | None = None,
        *,
        pose: Pose | None = None,
        second: float | None = None,
        camera: Camera | None = None,
    ) -> Floats:
        """(H, W, 3) float32 sRGB in [0, 1] of the view of a frame, or of a pose, as in ``ask``; by the frames' camera or another one."""
        if (view := self.viewpoint(frame, pose, second)) is None:
            raise UserError("render: give a frame or a pose")
        return self.trained.at(self.rests, view.second).picture(camera or self.camera, view.camera_to_world)

    def show(self, phrase: str, thing: Thing | Moving, resolution: int = 0) -> ViewMatch:
        """Show a thing that answers a phrase in the frame that shows it best: its pixels, and the relevancy of the whole view, of which
        ``resolution`` is the longer side [px]; 0 for the camera's. What moves has 1 in its pixels."""
        if isinstance(thing, Moving):
            labels = self.artifact("instances").row("labels", thing.frame)
            mask = np.asarray(np.isin(labels, thing.tracks).any(axis=0))
            place = innermost(mask), None, mask.astype(np.float32)
            return ViewMatch(phrase, 1.0, "track", *place, "track", mask)
        at = Viewpoint(f"frame {thing.frame}", self.poses[thing.frame], self.valid)
        options = self.options.change_keys(resolution=resolution)
        return show_thing(self.asked, thing, self.encode([phrase]), self.camera, at, options)

    def grading(self, options: QueryOptions | None = None) -> grades.Grading:
        """How answers of the whole scene are graded; by its own fit only where a user opened it, of which no stage knows."""
        own = None if self.checked else self.folder
        return grades.grading_of(self.encoded.facts["clip"]["hash"], options or self.options, own)

    @cached_property
    def contest(self) -> Contest | None:
        """Words of homes against which a query has to win; None for an OpenCLIP that was calibrated without them."""
        contested = grades.is_contested(self.encoded.facts["clip"]["hash"], grades.read_fits())
        return Contest(self.trained, self.clip, self.options) if contested else None

    @cached_property
    def _words(self) -> Texts:
        """Names of things, by which a query is told from others."""
        return self.encode(words_to_try(self.clip))


def open_scene(folder: str | Path, options: AskingOptions | None = None, **keys: Any) -> Scene:
    """Open a finished scene or variant, such as ``results/adt/scene1``. Only what describes its artifacts is read.

    Queries follow ``options``, or the defaults of the model, but for ``keys`` of the section ``query``, ``backend``, ``device`` or
    ``precision``, such as ``min_score=0.6``. UserError: a key is not valid, or an artifact is missing, damaged or of another scene."""
    folder = Path(folder)
    artifacts = open_artifacts(folder)
    clip_model = artifacts[-1].facts["clip"]["model"]
    return scene_of(artifacts, (options or AskingOptions()).suit(clip_model, **keys), folder)


def open_artifacts(folder: Path) -> list[Artifact]:
    """Open what queries of a scene or a variant read, what OpenCLIP encoded at last. Raises as ``open_scene``."""
    check_scene_folder(folder, ASKED)
    *paths, features, tiles = locate(folder, *ASKED, *ENCODED)
    by_tiles = "tiles.zarr" in open_artifact(paths[-1], SCHEMAS["language"]).provenance["inputs"]
    return [open_artifact(path, SCHEMAS[path.stem]) for path in (*paths, tiles if by_tiles else features)]


def scene_of(artifacts: Iterable[Artifact], options: AskingOptions, folder: Path | None = None) -> Scene:
    """Make a scene of opened artifacts that belong together: frames, poses, splats, language, features or tiles; there may be more.

    ``folder`` is that of the scene; None for that of the language artifact, whose bytes are known to have their digests."""
    given = tuple(artifacts)
    if not any(one.schema.name in ENCODED for one in given):
        raise UserError("needs the features artifact, or the tiles: give --features or --tiles")
    home = next(one.path.parent for one in given if one.schema.name == "language")
    return Scene(folder or home, given, lineage(given), options, checked=folder is None)
