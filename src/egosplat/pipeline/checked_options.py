"""Make options from values, with errors in plain words."""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from egosplat.errors import UserError
from egosplat.pipeline.messages import refusal
from egosplat.pipeline.options import Options, keys_of


def make_options(
    options: type[Options], values: Mapping[str, Any], where: str, names: Mapping[str, str]
) -> Options:
    """Make options, which checks the values and adds the defaults.

    Args:
        where: what gives the values, for messages.
        names: full name of each key, such as ``run.seed``, for messages.

    Raises:
        UserError: a key is unknown or has a forbidden value; names the first one.
    """
    try:
        return options.model_validate(values)
    except ValidationError as error:
        raise UserError(f"{where}: {refusal(error, values, keys_of(options), names)}") from None
