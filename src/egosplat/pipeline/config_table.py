"""The reference of all configuration keys as a Markdown page, and as a JSON schema for editors."""

import functools
import re
from collections.abc import Mapping
from typing import Any

from egosplat.pipeline.config import section_keys, section_options
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.messages import choices, kinds_of, limits_of, shown
from egosplat.pipeline.model_sets import DEFAULTS, PHOTOS, PUBLISHED
from egosplat.pipeline.options import Options, describe, keys_of

# Keys that people change first, at the top of the page.
FIRST_KEYS = (
    *("preset", "data_root", "frames.resolution", "frames.stride", "models.set", "run.device"),
    *("segments.points_per_side", "splats.iterations", "splats.max_gaussians", "query.min_score"),
)

# Heading of the keys that are in no section.
GENERAL = "general"

_HEAD = """# All configuration keys

`egosplat keys > config/reference.md` writes this page from the options of the stages (`options.py` in each folder of `src/egosplat/`);
`egosplat keys --schema` prints a JSON schema for editors. [README.md](README.md) has recipes and the order in which values are searched. A
changed key reruns the stages that take it and the stages after them. By hand: `egosplat splats --set iterations=500 ...`. A default after
"photos" or "published" holds with that `models.set`."""

_READINGS = """# Readings of the paper

Few people change these keys: most of them are choices that the paper leaves open, or values of the methods that it compares with.
`--help` of a command does not list them, `--help-all` does."""

# A page of the repository in a description, from the root.
_PAGE = re.compile(r"\b(?:docs|benchmarks)(?:/\w+)+\.md(?:#[\w-]+)?")

_COLUMNS = "| key | default | allowed | what it is |\n| --- | --- | --- | --- |"


def keys_page() -> str:
    """Every key with default, limits and description: the ten that people change first, all others, then the readings.

    ``config/reference.md`` holds this page.
    """
    first = "\n".join(_first_row(path) for path in FIRST_KEYS)
    return "\n\n".join(
        [
            _HEAD,
            f"## The ten keys to change first\n\n{_COLUMNS}\n{first}",
            *_tables("##", reading=False),
            _READINGS,
            *_tables("## Readings:", reading=True),
        ]
    )


def json_schema() -> dict[str, Any]:
    """Get a JSON schema of the configuration, for editors."""
    schema = GeneralOptions.model_json_schema()
    for section, (options, keys) in _sections().items():
        told = {name: key | {"description": describe(options, name)} for name, key in keys.items()}
        one = {"type": "object", "additionalProperties": False, "properties": told}
        schema["properties"] |= told if section == GENERAL else {section: one}
    return schema | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "egosplat configuration",
    }


def _tables(heading: str, reading: bool) -> list[str]:
    """A table for each section with such keys; keys outside of a section come first."""
    parts = []
    for section, (options, keys) in _sections().items():
        prefix = "" if section == GENERAL else f"{section}."
        rows = [
            _row(f"`{prefix}{name}`", section, name, describe(options, name))
            for name, key in keys.items()
            if bool(key.get("reading")) == reading
        ]
        if rows:
            parts.append("\n".join([f"{heading} {section}\n\n{_COLUMNS}", *rows]))
    return parts


@functools.cache
def _sections() -> dict[str, tuple[type[Options], dict[str, dict[str, Any]]]]:
    """Options and JSON schemas of the keys, by section."""
    found = {name: (options, section_keys(name)) for name, options in section_options().items()}
    return {GENERAL: (GeneralOptions, keys_of(GeneralOptions)), **found}


def _first_row(path: str) -> str:
    """A row with a link to the key's section and the first sentence of its description."""
    section, name = path.split(".") if "." in path else (GENERAL, path)
    sentence = describe(_sections()[section][0], name).split(". ")[0].rstrip(".") + "."
    return _row(f"[`{path}`](#{section})", section, name, sentence)


def _row(shown_name: str, section: str, name: str, text: str) -> str:
    key = _sections()[section][1][name]
    # The pages that a description cites are links.
    linked = _PAGE.sub(r"[\g<0>](../\g<0>)", text)
    allowed = ", ".join([*kinds_of(key), *(f"`{word}`" for word in choices(key)), *limits_of(key)])
    return f"| {shown_name} | {_default(section, name, key)} | {allowed} | {linked} |"


def _default(section: str, name: str, key: Mapping[str, Any]) -> str:
    """The default as YAML, and those of other sets of models; for several named things, the names."""
    value = key["default"]
    text = ", ".join(f"`{one}`" for one in (value if isinstance(value, Mapping) else [shown(value)]))
    sets = {one: DEFAULTS[one].get(section, {}).get(name, value) for one in (PHOTOS, PUBLISHED)}
    return "; ".join([text, *(f"{one}: `{shown(other)}`" for one, other in sets.items() if other != value)])
