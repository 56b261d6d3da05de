"""The reference of all configuration keys as a Markdown page."""

import functools
import re
from typing import Any

from egosplat.pipeline.config import section_keys, section_options
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.messages import choices, kinds_of, limits_of, shown
from egosplat.pipeline.model_sets import DEFAULTS, LIGHT, PHOTOS, PUBLISHED
from egosplat.pipeline.options import keys_of

# Keys that people change first, at the top of the page.
FIRST_KEYS = (
    *("preset", "data_root", "frames.resolution", "frames.stride", "models.set", "run.device"),
    *("segments.points_per_side", "splats.iterations", "splats.max_gaussians", "query.min_score"),
)

# Heading of the keys that are in no section.
GENERAL = "general"

_HEAD = """# All configuration keys

`egosplat keys > config/reference.md` writes this page from the options of the stages (`options.py` in each folder of `src/egosplat/`).
[README.md](README.md) has recipes and the order in which values are searched. A changed key reruns the stages that take it and the
stages after them. By hand: `egosplat splats --set iterations=500 ...`. A default after
"photos", "light" or "published" holds with that `models.set`."""

_READINGS = """# Readings of the paper

Few people change these keys: most of them are choices that the paper leaves open, or values of the methods that it compares with.
`--help` of a command does not list them."""

# A page of the repository in a description, from the root.
_PAGE = re.compile(r"\b(?:docs|benchmarks)(?:/\w+)+\.md(?:#[\w-]+)?")

_COLUMNS = "| key | default | allowed | what it is |\n| --- | --- | --- | --- |"


def keys_page() -> str:
    """Every key with default, limits and description: the ten that people change first, all others, then the readings.

    ``config/reference.md`` holds this page.
    """
    first = []
    for path in FIRST_KEYS:
        section, name = path.split(".") if "." in path else (GENERAL, path)
        key = _sections()[section][name]
        sentence = key["description"].split(". ")[0].rstrip(".") + "."
        first.append(_row(f"[`{path}`](#{section})", section, name, key | {"description": sentence}))
    parts = ["## The ten keys to change first", "\n".join([_COLUMNS, *first])]
    parts += [*_tables("##", reading=False), _READINGS, *_tables("## Readings:", reading=True)]
    return "\n\n".join([_HEAD, *parts])


@functools.cache
def _sections() -> dict[str, dict[str, dict[str, Any]]]:
    """Schemas of the keys by section; those outside of a section come first."""
    return {GENERAL: keys_of(GeneralOptions)} | {name: section_keys(name) for name in section_options()}


def _tables(heading: str, reading: bool) -> list[str]:
    """A table for each section with such keys."""
    tables = []
    for section, keys in _sections().items():
        prefix = "" if section == GENERAL else f"{section}."
        kept = {name: key for name, key in keys.items() if bool(key.get("reading")) == reading}
        rows = [_row(f"`{prefix}{name}`", section, name, key) for name, key in kept.items()]
        tables += ["\n".join([f"{heading} {section}\n\n{_COLUMNS}", *rows])] if rows else []
    return tables


def _row(link: str, section: str, name: str, key: dict[str, Any]) -> str:
    # The pages that a description cites are links.
    text = _PAGE.sub(r"[\g<0>](../\g<0>)", key["description"])
    allowed = ", ".join([*kinds_of(key), *(f"`{word}`" for word in choices(key)), *limits_of(key)])
    # The default as YAML, and those of other sets of models; for several named things, the names.
    value = key["default"]
    default = ", ".join(f"`{item}`" for item in (value if isinstance(value, dict) else [shown(value)]))
    for chosen in (PHOTOS, LIGHT, PUBLISHED):
        other = DEFAULTS[chosen].get(section, {}).get(name, value)
        default += "" if other == value else f"; {chosen}: `{shown(other)}`"
    return f"| {link} | {default} | {allowed} | {text} |"
