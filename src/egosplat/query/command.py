"""Query a finished scene: ``egosplat query``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.lineage import Lineage, lineage
from egosplat.artifacts.reader import Artifact, open_artifact, verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.errors import UserError
from egosplat.models.suitability import notice_of_artifacts
from egosplat.query.answers import (
    MOST_DRAWN,
    Question,
    answer_in_scene,
    answer_in_view,
)
from egosplat.query.options import QueryOptions
from egosplat.query.scene import read_scene
from egosplat.query.sources import QuerySources, find_sources
from egosplat.query.text import encode_texts, load_clip_of, untaught_words
from egosplat.query.viewpoint import Viewpoint, file_viewpoint, frame_viewpoint


@dataclass(frozen=True)
class Asking:
    """The view to query, and the output.

    Attributes:
        frame: index of a frame, or None.
        pose: JSON file of a pose, or None. Without frame and pose, the whole scene is queried.
        most: maximum number of things in an answer of the whole scene.
        output: picture to write.
    """

    frame: int | None
    pose: Path | None
    most: int
    output: Path


def run(
    folder: Path,
    phrases: Sequence[str],
    asking: Asking,
    options: QueryOptions,
    *,
    backend: str,
    device: str,
    precision: str,
) -> Iterator[str]:
    """Answer queries in a table, then in a picture.

    Args:
        folder: folder of a scene or a variant.
        phrases: the queries, at least one; the OpenCLIP model that made the features encodes them.
        asking: the view to query, and the output.
        backend: renderer, as the key ``backend``.
        device, precision: of OpenCLIP, as the keys of the section ``models``.

    Yields:
        The table as soon as it is known, then a line about the picture once it is drawn.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others; its OpenCLIP is missing; the frame
            has no pose, or the pose cannot be read; or a phrase is not valid.
    """
    sources, made_from = open_sources(folder)
    viewpoint = _viewpoint(sources, asking)
    question = open_question(sources, phrases, options, backend=backend, device=device, precision=precision)
    if viewpoint is None:
        answered = answer_in_scene(question, sources, asking.most)
    else:
        answered = answer_in_view(question, sources, viewpoint)
    notice = notice_of_artifacts(made_from.found.values())
    title = f"{folder}, {answered.place}, origin {sources.language.origin}"
    title = "\n".join(filter(None, (title, notice)))
    yield f"{title}\n{answers_table(answered.columns, answered.rows)}"

    # Here, because matplotlib takes as long to import as a query to answer.
    from egosplat.query.sheet import draw_answers

    draw_answers(list(answered.drawn), title, asking.output)
    more = f" (the first {MOST_DRAWN} answers; {answered.left_out} more are in the table only)"
    yield f"picture: {asking.output}{more if answered.left_out else ''}"


def answers_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table with aligned columns, one line per row.

    Args:
        columns: C column names.
        rows: rows of C cells. The last cell of a shorter row is a sentence that does not widen its column.
    """
    every = [columns, *rows]
    cells = [row if len(row) == len(columns) else row[:-1] for row in every]
    widths = [max(len(row[place]) for row in cells if place < len(row)) for place in range(len(columns))]
    lines = ("  ".join(map(str.ljust, row, [*widths[: len(row) - 1], 0])).rstrip() for row in every)
    return "\n".join(lines)


def open_sources(folder: Path) -> tuple[QuerySources, Lineage]:
    """Open the artifacts of a scene or a variant, and check that they belong together.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others.
    """
    # Frames are not verified: they may hold gigabytes, and queries read only little of them.
    frames, *others = find_sources(folder)
    sources = QuerySources(open_artifact(frames, FRAMES), *map(_verified, others))
    return sources, lineage(list(vars(sources).values()))


def open_question(
    sources: QuerySources,
    phrases: Sequence[str],
    options: QueryOptions,
    *,
    backend: str,
    device: str,
    precision: str,
) -> Question:
    """Read the scene and encode the queries; arguments as in ``run``.

    Raises:
        UserError: the OpenCLIP that made the features is missing, the backend cannot run, or a phrase is not valid.
    """
    made_with = sources.encoded.facts["clip"]
    clip = load_clip_of(sources.encoded, made_with["model"], made_with["checkpoint"], device, precision)
    return Question(
        texts=encode_texts(clip, list(dict.fromkeys(phrases)), options.canonical),
        untaught={phrase: untaught_words(clip, phrase) for phrase in phrases},
        options=options,
        scene=read_scene(sources.splats, sources.language, sources.encoded, backend),
    )


def _verified(path: Path) -> Artifact:
    schema = SCHEMAS[path.stem]
    # Opening reports a missing artifact, or one of another kind, more clearly than verifying.
    open_artifact(path, schema)
    return verify(path, {schema.name: schema})


def _viewpoint(sources: QuerySources, asking: Asking) -> Viewpoint | None:
    """The view to query; None for the whole scene."""
    if asking.frame is not None and asking.pose is not None:
        raise UserError("--frame and --pose: give one of them")
    if asking.pose is not None:
        return file_viewpoint(asking.pose)
    if asking.frame is not None:
        return frame_viewpoint(sources.frames, sources.poses, sources.splats, asking.frame)
    return None
