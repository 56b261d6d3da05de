"""What ``survey.json`` says: the decisions that other stages follow."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.output_files import stage_json_kind, write_json
from egosplat.pipeline.validation import Draft202012Validator, schema

FORMAT_VERSION = 1

SURVEY = stage_json_kind("survey")

Survey = Mapping[str, Any]


def write_survey(output: Path, document: Survey) -> None:
    """Check a survey and write it, with sorted keys; the file appears when it is complete.

    Raises:
        jsonschema.ValidationError: it is not what the schema describes.
        UserError: something is at ``output`` that is no survey.
    """
    Draft202012Validator(schema("survey")).validate(document)
    write_json(output, document, SURVEY)


def read_survey(path: Path) -> Survey:
    """Read a survey.

    Raises:
        UserError: it is absent, or not what the schema describes.
    """
    try:
        document = read_json(path)
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Make it: snakemake --cores 2 {path}") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read as JSON ({error}). {made_anew(path)}") from None
    for error in Draft202012Validator(schema("survey")).iter_errors(document):
        key = ".".join(str(part) for part in error.absolute_path) or "it"
        raise UserError(
            f"{path}: is no survey of this egosplat: {key}: {error.message[:200]}. {made_anew(path)}"
        )
    return document


def gaussians_learn_from_all(survey: Survey, masking: str) -> bool:
    """Whether Gaussians are trained on what a survey leaves out, too: where nothing moves, and nothing is masked.

    Their training has as many iterations of however many frames, so leaving some out saves nothing there. Where
    something moves only frames that stay are segmented, and so masked; the others would teach what moves.
    """
    return masking == "none" and survey["motion"]["static"]


def digest_of_frames(kept: Iterable[int]) -> str:
    """SHA-256 of a list of frames."""
    return hashlib.sha256(json.dumps([int(frame) for frame in kept]).encode()).hexdigest()


def made_anew(path: Path) -> str:
    """What to do about a survey that is of no use."""
    return f"Make it anew: rm {path}, then snakemake --cores 2 {path}"
