"""Write ``survey.json``."""

from pathlib import Path

from egosplat.files import write_json
from egosplat.pipeline.survey_file import Survey
from egosplat.pipeline.validation import Draft202012Validator, schema

FORMAT_VERSION = 5


def write_survey(output: Path, document: Survey) -> None:
    """Check a survey and write it with sorted keys. The file appears only when it is complete.

    Raises:
        jsonschema.ValidationError: the survey does not match the schema.
    """
    Draft202012Validator(schema("survey")).validate(document)
    write_json(output, document)
