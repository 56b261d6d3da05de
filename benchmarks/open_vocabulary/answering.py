"""The phrases asked of a finished scene, and scored as the stage ``metrics`` scores its queries."""

from dataclasses import dataclass
from pathlib import Path

from benchmarks.open_vocabulary.colors import color_shares
from benchmarks.open_vocabulary.questions import Question, find_questions
from egosplat.errors import UserError
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.evaluation.scores import Result, ask_of, run_queries
from egosplat.pipeline.config import Config, stage_values
from egosplat.report.sheets.queries_sheet import evaluation_of, open_scored


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
    options = recorded_options(stage_values("metrics", config))
    scene = open_scored(folder, options)
    if not scene.encoded.facts["clip"]["small"] or scene.origin != "synthetic":
        raise UserError(f"{folder}: the phrases are made for synthetic apartments and the small OpenCLIP")
    evaluation = evaluation_of(scene)
    questions = _questions(evaluation, config, options)
    of_query = {id(one.query): one for one in questions}
    queries = [one.query for one in questions]
    asker = scene.asker(sorted({query.category for query in queries}))
    ask = ask_of(evaluation, asker)
    answers = run_queries(queries, ask, evaluation.annotations, evaluation.valid, options)
    return [Answered(of_query[id(one.query)], one.groups["all"]) for one in answers]


def _questions(evaluation: Evaluation, config: Config, options: MetricsOptions) -> list[Question]:
    maps = {frame.index: evaluation.map_of(frame) for frame in evaluation.frames if frame.asked}
    queries = evaluation.find_queries(options)
    shares = color_shares(config["synthetic"], evaluation.instances)
    return find_questions(queries, maps, shares, options.min_area)
