"""The phrases asked of a finished scene, and scored as the stage ``metrics`` scores its queries."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from benchmarks.open_vocabulary.colours import colour_shares
from benchmarks.open_vocabulary.questions import Question, find_questions
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError
from egosplat.evaluation.evaluation_frames import Evaluation, read_evaluation
from egosplat.evaluation.queries import BenchmarkQueries, find_queries
from egosplat.evaluation.scores import Result, score_query
from egosplat.pipeline.config import Config, stage_values
from egosplat.progress import track
from egosplat.query.answer import ask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import read_scene
from egosplat.query.text import Texts, encode_texts, load_clip_of

_SCHEMAS = {
    "frames": FRAMES,
    "poses": POSES,
    "annotations": ANNOTATIONS,
    "features": FEATURES,
    "splats": SPLATS,
    "language": LANGUAGE,
}


@dataclass(frozen=True)
class Answered:
    """A question with its result."""

    question: Question
    result: Result


def answer_scene(folder: Path, config: Config) -> list[Answered]:
    """Ask all phrases of a finished synthetic scene.

    Args:
        folder: of the scene.
        config: of the scene, which its recording was made with.

    Raises:
        UserError: the scene is not synthetic, was made with another OpenCLIP than the small one, or is not finished.
    """
    read = {name: open_artifact(folder / f"{name}.zarr", schema) for name, schema in _SCHEMAS.items()}
    lineage(list(read.values()))
    if not read["features"].facts["clip"]["small"] or read["annotations"].origin != "synthetic":
        raise UserError(f"{folder}: the phrases are made for synthetic apartments and the small OpenCLIP")
    keys = stage_values("metrics", config)
    evaluation = read_evaluation(*(read[name] for name in ("frames", "poses", "annotations", "splats")))
    questions = _questions(evaluation, config, keys)
    phrases = sorted({one.query.category for one in questions})
    clip = load_clip_of(
        read["features"], *(keys[name] for name in ("clip_model", "clip_checkpoint", "device", "precision"))
    )
    texts = encode_texts(clip, phrases, keys["canonical"])
    return list(_answers(questions, evaluation, read, texts, keys))


def _questions(evaluation: Evaluation, config: Config, keys: Config) -> list[Question]:
    wanted = BenchmarkQueries(
        min_area=keys["min_area"], excluded=tuple(keys["excluded"]), people=keys["people"]
    )
    frames = {frame.row: frame for frame in evaluation.frames if frame.asked}
    found = find_queries(evaluation.annotations, evaluation.valid, wanted)
    queries = [query for query in found if query.row in frames]
    maps = {frame.index: evaluation.map_of(frame) for frame in frames.values()}
    shares = colour_shares(config["synthetic"], evaluation.instances)
    return find_questions(queries, maps, shares, keys["min_area"])


def _answers(
    questions: Sequence[Question],
    evaluation: Evaluation,
    read: dict[str, Artifact],
    texts: Texts,
    keys: Config,
) -> Iterator[Answered]:
    named = {field.name: keys[field.name] for field in fields(QueryOptions)}
    options = QueryOptions(**named | {"canonical": tuple(named["canonical"])})
    scene = read_scene(read["splats"], read["language"], read["features"], keys["backend"])
    frames = {frame.index: frame for frame in evaluation.frames}
    for index in track(sorted({one.query.frame for one in questions}), "asking"):
        own = [one for one in questions if one.query.frame == index]
        truth, pose = evaluation.map_of(frames[index]), evaluation.camera_to_world[index]
        words = texts.of(sorted({one.query.category for one in own}))
        for answer in ask(scene, words, evaluation.camera, pose, evaluation.valid, options):
            for one in own:
                if one.query.category == answer.phrase:
                    score = score_query(
                        one.query, answer.pixel, answer.mask, truth, evaluation.valid, keys["hit_region"]
                    )
                    yield Answered(one, score.groups["all"])
