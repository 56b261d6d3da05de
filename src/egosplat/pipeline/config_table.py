"""The reference of all configuration keys as a Markdown page, and as a JSON schema for editors."""

import functools
import re
from typing import Any, NamedTuple

from egosplat.pipeline.config import section_keys, section_options
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.messages import choices, kinds_of, limits_of, shown
from egosplat.pipeline.model_sets import DEFAULTS, PHOTOS, PUBLISHED
from egosplat.pipeline.options import keys_of

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
`--help` of a command does not list them."""

# A page of the repository in a description, from the root.
_PAGE = re.compile(r"\b(?:docs|benchmarks)(?:/\w+)+\.md(?:#[\w-]+)?")

_COLUMNS = "| key | default | allowed | what it is |\n| --- | --- | --- | --- |"


class _Key(NamedTuple):
    section: str
    name: str
    schema: dict[str, Any]


def keys_page() -> str:
    """Every key with default, limits and description: the ten that people change first, all others, then the readings.

    ``config/reference.md`` holds this page.
    """
    first = []
    for path in FIRST_KEYS:
        key = _keys()[path]
        sentence = key.schema["description"].split(". ")[0].rstrip(".") + "."
        first.append(_row(f"[`{path}`](#{key.section})", key, sentence))
    tables = _tables("##", reading=False), _tables("## Readings:", reading=True)
    parts = [
        "## The ten keys to change first",
        "\n".join([_COLUMNS, *first]),
        *tables[0],
        _READINGS,
        *tables[1],
    ]
    return "\n\n".join([_HEAD, *parts])


def json_schema() -> dict[str, Any]:
    """Get a JSON schema of the configuration, for editors."""
    schema, told = GeneralOptions.model_json_schema(), {"title": "egosplat configuration"}
    for key in _keys().values():
        properties = schema["properties"]
        if key.section != GENERAL:
            section = {"type": "object", "additionalProperties": False, "properties": {}}
            properties = properties.setdefault(key.section, section)["properties"]
        properties[key.name] = key.schema
    return schema | told | {"$schema": "https://json-schema.org/draft/2020-12/schema"}


@functools.cache
def _keys() -> dict[str, _Key]:
    """All keys by path; those outside of a section come first."""
    keys = {name: _Key(GENERAL, name, schema) for name, schema in keys_of(GeneralOptions).items()}
    sections = [(section, section_keys(section).items()) for section in section_options()]
    return keys | {
        f"{part}.{name}": _Key(part, name, schema) for part, items in sections for name, schema in items
    }


def _tables(heading: str, reading: bool) -> list[str]:
    """A table for each section with such keys."""
    rows: dict[str, list[str]] = {}
    for path, key in _keys().items():
        if bool(key.schema.get("reading")) == reading:
            rows.setdefault(key.section, []).append(_row(f"`{path}`", key, key.schema["description"]))
    return ["\n".join([f"{heading} {section}\n\n{_COLUMNS}", *part]) for section, part in rows.items()]


def _row(shown_name: str, key: _Key, text: str) -> str:
    # The pages that a description cites are links.
    linked = _PAGE.sub(r"[\g<0>](../\g<0>)", text)
    words = [f"`{word}`" for word in choices(key.schema)]
    allowed = ", ".join([*kinds_of(key.schema), *words, *limits_of(key.schema)])
    # The default as YAML, and those of other sets of models; for several named things, the names.
    value = key.schema["default"]
    default = ", ".join(f"`{item}`" for item in (value if isinstance(value, dict) else [shown(value)]))
    for chosen in (PHOTOS, PUBLISHED):
        other = DEFAULTS[chosen].get(key.section, {}).get(key.name, value)
        default += "" if other == value else f"; {chosen}: `{shown(other)}`"
    return f"| {shown_name} | {default} | {allowed} | {linked} |"
