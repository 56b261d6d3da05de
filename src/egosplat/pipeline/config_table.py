"""The reference of all configuration keys as a Markdown page."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from egosplat.pipeline.config import schema
from egosplat.pipeline.published import PUBLISHED

# Keys that people change first, at the top of the page.
FIRST_KEYS = (
    "preset",
    "data_root",
    "frames.resolution",
    "frames.stride",
    "models.set",
    "models.device",
    "segments.points_per_side",
    "splats.iterations",
    "splats.max_gaussians",
    "query.min_score",
)

# Heading of the keys that are in no section.
_GENERAL = "general"

_HEAD = """# All configuration keys

`egosplat keys > config/reference.md` writes this page from `src/egosplat/pipeline/schemas/config.schema.yaml`. [README.md](README.md) has
recipes and the order in which values are searched. A section with the name of a stage holds the command line flags of that stage: a
changed key reruns that stage and the stages after it. Every stage that loads a model reads `models`. The stage `metrics` and
`egosplat query` read `query`. A default after "published" holds with `models.set: published`."""

# A page of the repository in a description, from the root.
_PAGE = re.compile(r"\b(?:docs|benchmarks)(?:/\w+)+\.md(?:#[\w-]+)?")

_COLUMNS = "| key | default | what it is |\n| --- | --- | --- |"


def keys_page() -> str:
    """Every key with its default and description: the ten keys that people change first, then all by section.

    ``config/reference.md`` holds this page.
    """
    sections = _sections()
    keys = {path: (section, key) for section, group in sections.items() for path, key in group.items()}
    first = "\n".join(_first_row(path, *keys[path]) for path in FIRST_KEYS)
    parts = [_HEAD, f"## The ten keys to change first\n\n{_COLUMNS}\n{first}"]
    for section, group in sections.items():
        rows = "\n".join(_row(f"`{path}`", key, _text(key)) for path, key in group.items())
        parts.append(f"## {section}\n\n{_COLUMNS}\n{rows}")
    return "\n\n".join(parts)


def _sections() -> dict[str, dict[str, Mapping[str, Any]]]:
    """For each heading its keys by path; keys outside of a section come first."""
    sections: dict[str, dict[str, Mapping[str, Any]]] = {_GENERAL: {}}
    for section, path, key in _keys():
        sections.setdefault(section, {})[path] = key
    return sections


def _keys() -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Heading, path and schema of each key, in the schema's order."""
    for section, part in schema("config")["properties"].items():
        if not part.get("properties"):
            yield _GENERAL, section, part
            continue
        for name, key in part["properties"].items():
            yield section, f"{section}.{name}", key


def _first_row(path: str, section: str, key: Mapping[str, Any]) -> str:
    """A row with a link to the key's section and the first sentence of its description."""
    sentence = _text(key).split(". ")[0].rstrip(".") + "."
    return _row(f"[`{path}`](#{section})", key, sentence)


def _row(name: str, key: Mapping[str, Any], text: str) -> str:
    return f"| {name} | {_default(key)} | {text}{_choices(key)} |"


def _text(key: Mapping[str, Any]) -> str:
    """The description on one line; the pages that it cites are links."""
    return _PAGE.sub(r"[\g<0>](../\g<0>)", " ".join(key["description"].split()))


def _choices(key: Mapping[str, Any]) -> str:
    """The values that are allowed, where they are few."""
    return f" One of {', '.join(f'`{choice}`' for choice in key['enum'])}." if "enum" in key else ""


def _default(key: Mapping[str, Any]) -> str:
    """The default as YAML, and that of the published models; for several named things, the names."""
    value = key["default"]
    shown = ", ".join(f"`{one}`" for one in (value if isinstance(value, Mapping) else [_shown(value)]))
    return f"{shown}; published: `{_shown(key[PUBLISHED])}`" if PUBLISHED in key else shown


def _shown(value: Any) -> str:
    """A value as YAML on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=1000).splitlines()[0]
