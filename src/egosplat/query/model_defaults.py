"""Defaults of queries that follow the models of a scene."""

from typing import Any, TypeVar

from egosplat.pipeline.model_sets import DEFAULTS
from egosplat.pipeline.published import PUBLISHED
from egosplat.query.options import AskingOptions

Asking = TypeVar("Asking", bound=AskingOptions)


def suit_options(options: Asking, clip_model: str, **keys: Any) -> Asking:
    """Give keys of ``query`` that nobody set the defaults of the set of models that made a scene's features.

    Args:
        clip_model: its OpenCLIP; another one than those of the sets is asked as the published ones.
        keys: keys that are set, too.
    """
    defaults = DEFAULTS.get(clip_model, DEFAULTS[PUBLISHED])["query"]
    unset = {key: value for key, value in defaults.items() if key not in options.model_fields_set}
    return options.change_keys(**unset | keys)
