"""Questions to a finished scene: ``egosplat query``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reading import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError
from egosplat.models.suitability import notice_of_artifacts
from egosplat.output_files import check_output
from egosplat.query.asking import ask
from egosplat.query.clip import load_clip_of
from egosplat.query.options import QueryOptions
from egosplat.query.scene import read_scene
from egosplat.query.text import encode_texts
from egosplat.query.viewpoint import Viewpoint, file_viewpoint, frame_viewpoint
from egosplat.report.query_sheet import QUERY_PICTURE, draw_answers
from egosplat.report.query_table import answers_table
from egosplat.report.trained_scene import open_trained_scene


@dataclass(frozen=True)
class _Sources:
    frames: Artifact
    poses: Artifact
    features: Artifact
    splats: Artifact
    language: Artifact


@dataclass(frozen=True)
class Asking:
    """Where a question is asked from, and what is made of the answers.

    Attributes:
        frame: index of a frame, or None; ``pose``: a JSON file, or None. With neither, the middle frame with a pose.
        output: picture to make; None for query.png in the scene's folder.
    """

    frame: int | None
    pose: Path | None
    output: Path | None


def run(
    folder: Path,
    phrases: Sequence[str],
    asking: Asking,
    options: QueryOptions,
    *,
    backend: str,
    device: str,
    precision: str,
) -> str:
    """Answer in words and in a picture.

    Args:
        folder: with the artifacts of a scene.
        phrases: one at least; they are read by the OpenCLIP that the features were made with.
        asking: from where, and which picture to make.
        options: how queries are answered.
        backend: what renders; device, precision: of the model, as the keys of the section ``models``.

    Returns:
        A table.

    Raises:
        UserError: an artifact is missing or does not belong to the others, its OpenCLIP is not there any more, the
            frame or pose cannot be had, a phrase cannot be asked, or the picture would replace something else.
    """
    output = folder / "query.png" if asking.output is None else asking.output
    check_output(output, QUERY_PICTURE)
    sources = _open(folder)
    viewpoint = _viewpoint(sources, asking)
    made_with = sources.features.facts["clip"]
    clip = load_clip_of(sources.features, made_with["model"], made_with["checkpoint"], device, precision)
    texts = encode_texts(clip, phrases, options.canonical)
    scene = read_scene(sources.splats, sources.language, sources.features, backend)
    drawn = open_trained_scene(sources.poses.path, sources.splats.path)
    pose, levels = viewpoint.camera_to_world, sources.language.facts["levels"]
    answers = list(ask(scene, texts, drawn.camera, pose, viewpoint.valid, options))
    title = f"{folder}, {viewpoint.name}, origin {sources.language.origin}"
    # Below the title, in the table as in the picture.
    title = "\n".join(filter(None, (title, notice_of_artifacts(lineage([sources.language]).found.values()))))
    draw_answers(drawn.picture(drawn.camera, pose), answers, levels, title, output)
    return f"{title}\n{answers_table(answers, levels)}\npicture: {output}"


def _open(folder: Path) -> _Sources:
    schemas = {
        "frames": FRAMES,
        "poses": POSES,
        "features": FEATURES,
        "splats": SPLATS,
        "language": LANGUAGE,
    }
    opened = {name: open_artifact(folder / f"{name}.zarr", schema) for name, schema in schemas.items()}
    lineage(list(opened.values()))
    return _Sources(**opened)


def _viewpoint(sources: _Sources, asking: Asking) -> Viewpoint:
    if asking.pose is None:
        return frame_viewpoint(sources.frames, sources.poses, asking.frame)
    if asking.frame is not None:
        raise UserError("--frame and --pose: give one of them")
    return file_viewpoint(asking.pose)
