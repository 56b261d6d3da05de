"""The table of all keys, for people."""

from collections.abc import Mapping
from typing import Any

import yaml

from egosplat.config import schema


def keys_table() -> str:
    """Every key with its default and description, as a Markdown table; config/README.md holds it."""
    rows = ["| key | default | what it is |", "| --- | --- | --- |"]
    for section, part in schema("config")["properties"].items():
        keys = part.get("properties") or {"": part}
        for name, key in keys.items():
            path = f"{section}.{name}" if name else section
            rows.append(
                f"| `{path}` | {_default(key)} | {' '.join(key['description'].split())}{_choices(key)} |"
            )
    return "\n".join(rows)


def _default(key: Mapping[str, Any]) -> str:
    """As it is written in a file; of several named things, the names."""
    value = key["default"]
    return ", ".join(f"`{one}`" for one in (value if isinstance(value, Mapping) else [_shown(value)]))


def _shown(value: Any) -> str:
    """A value as it is written in YAML, on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=1000).splitlines()[0]


def _choices(key: Mapping[str, Any]) -> str:
    return f" One of {', '.join(f'`{choice}`' for choice in key['enum'])}." if "enum" in key else ""
