"""Values that keys do not allow, in files, on the command line of the workflow and of each stage."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator

from bad_input_bench.cases import Case, Sandbox, Words, stage_flags
from egosplat.doctor.configured import read_configuration
from egosplat.pipeline.config import schema, stage_keys
from egosplat.pipeline.scenes import read_scenes
from egosplat.pipeline.stages import STAGES

HUGE = 10**40
DEEP = 20_000
PER_KEY = 2


def cases(rng: random.Random) -> Iterator[Case]:
    """All of this family."""
    yield from _values(rng)
    yield from _files()
    yield from _options()
    yield from _flags(rng)


def wrong_values(key: dict[str, Any]) -> list[Any]:
    """Values that a key's schema forbids."""
    kinds = key.get("type", "enum")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    wrong: list[Any] = [{"a": {"b": 1}}]
    if "array" not in kinds:
        wrong.append([[1], "x"])
    if "string" not in kinds:
        wrong += ["; touch ../outside/canary", "é\n\u202e" * 5000, True if "boolean" not in kinds else 3]
    if "string" in kinds:
        wrong += [3, ""] if key.get("minLength") else [3]
    if {"number", "integer"} & set(kinds):
        wrong += [float("nan"), float("inf"), float("-inf"), "1e400"]
        wrong += [
            limit - 1 for name in ("minimum", "exclusiveMinimum") if (limit := key.get(name)) is not None
        ]
        wrong += [
            limit + 1 for name in ("maximum", "exclusiveMaximum") if (limit := key.get(name)) is not None
        ]
    return wrong if "null" in kinds else [*wrong, None]


def _values(rng: random.Random) -> Iterator[Case]:
    """Two values of every key, in a file."""
    for section, part in schema("config")["properties"].items():
        for name, key in (part.get("properties") or {"": part}).items():
            for value in rng.sample(found := wrong_values(key), min(PER_KEY, len(found))):
                tree = {section: {name: value} if name else value}
                text = yaml.safe_dump(tree, allow_unicode=True)
                label = f"{section}.{name}".strip(".")
                yield _file("configuration: values", f"{label} = {str(value)[:40]!r}", text, (label,))


def _file(family: str, name: str, content: str | bytes, named: tuple[str, ...]) -> Case:
    def command(box: Sandbox) -> Callable[[], object]:
        path = box.folder / "mine.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return lambda: _meet([path], [])

    return Case(family, name, command, named, scene=False)


def _files() -> Iterator[Case]:
    contents: dict[str, str | bytes] = {
        "no YAML": "frames: [",
        "tabs": "frames:\n\tstride: 2\n",
        "zero bytes": b"\0" * 1000,
        "UTF-16": "frames: {stride: 2}".encode("utf-16"),
        "Latin-1": "scenes: K\u00fcche.tsv".encode("latin-1"),
        "a list": "- frames\n",
        "a word": "hello",
        "a number": "3",
        "two documents": "frames: {}\n---\nframes: {}\n",
        "an object of Python": "frames: !!python/object/apply:os.system ['touch ../outside/canary']",
        "nested without end": "[" * DEEP,
        "keys nested without end": "{a: " * DEEP,
        "an unknown anchor": "frames: *nothing",
        "a key that is a list": "{[1, 2]: 3}",
        "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
        "an unknown key, odd": '"frames\\nq$(touch ../outside/canary)": 1',
        "keys of several kinds": "data_root: {1: a, b: c, true: d}",
        "a variant called 1": "variants: {1: {frames: {stride: 2}}}",
        "a variant with a newline": '"variants": {"a\\n": {frames: {stride: 2}}}',
        "a knob with a newline": '"tradeoff": {knobs: {"frames.stride\\n": [1]}}',
        "an alias of itself": "frames: &a {stride: *a}",
        "a date": "frames: {stride: 2020-01-01}",
        "a whole number as 3.0": "frames: {stride: 3.0}",
    }
    named = {
        "an unknown key, odd": ("frames",),
        "keys of several kinds": ("data_root",),
        "a variant called 1": ("variants",),
        "a variant with a newline": ("variants",),
        "a knob with a newline": ("tradeoff",),
        "an alias of itself": ("frames",),
        "a date": ("frames.stride",),
        "a whole number as 3.0": ("frames.stride",),
    }
    for name, content in contents.items():
        yield _file("configuration: files", name, content, named.get(name, ("mine.yaml",)))
    for name, path in {"a folder": Path("config"), "none": Path("no.yaml"), "long": Path("x" * 300)}.items():
        yield _read("configuration: files", name, [path], [], path.name)


def _options() -> Iterator[Case]:
    """``--config`` of ``egosplat doctor``; that of Snakemake is tried with the workflow."""
    options = {
        "preset": "preset",
        "=": "KEY=VALUE",
        "preset=": "KEY=VALUE",
        "preset=[": "KEY=VALUE",
        "preset=$(touch ../outside/canary)": "preset",
        "frames=3": "frames",
        "frames={stride: .nan}": "frames.stride",
        "splats={lr_means: .inf}": "splats",
        "scenes=../outside": "outside",
        "scenes=": "KEY=VALUE",
        "scenes=" + "x" * 300: "xxx",
        "scenes='a\\0b'": "scenes",
        f"frames={{stride: {HUGE}}}": "frames.stride",
        "data_root={adt: [a]}": "data_root",
        "data_root={nothing: /tmp}": "data_root",
        "[" * 5000: "KEY=VALUE",
        "a=" + "[" * 5000: "KEY=VALUE",
        "tradeoff={seeds: [-1]}": "tradeoff.seeds",
        "models={clip_model: ''}": "models.clip_model",
    }
    for text, named in options.items():
        yield _read("configuration: --config", text[:60], [], [text], named)


def _read(family: str, name: str, files: list[Path], options: list[str], named: str) -> Case:
    return Case(family, name, lambda _: lambda: _meet(files, options), (named,), scene=False)


def _meet(files: list[Path], options: list[str]) -> None:
    """What ``egosplat doctor`` and the workflow begin with."""
    read_scenes(read_configuration(files, options)[0])


def _flags(rng: random.Random) -> Iterator[Case]:
    """One value of every flag of every stage, on an input that is there."""
    for stage in STAGES:
        for name, key in stage_keys(stage).items():
            free = key.get("type") in ("boolean", "string") and "enum" not in key
            if free:
                continue  # a switch has no value, and any text may be a path
            texts = [text for text in map(_as_text, wrong_values(key)) if text and not _may_be(text, key)]
            if texts:
                yield _flag(stage, name, rng.choice(texts))


def _as_text(value: Any) -> str | None:
    """A value as a command line has it; of those that are texts there, too, None."""
    if isinstance(value, float | int) and not isinstance(value, bool):
        return str(value)
    return value if isinstance(value, str) and value else None


def _may_be(text: str, key: dict[str, Any]) -> bool:
    """Whether a key allows what a command line writes so."""
    allowed = Draft202012Validator(key)
    return allowed.is_valid(text) or (text.isdigit() and allowed.is_valid(int(text)))


def _flag(stage: str, name: str, text: str) -> Case:
    flag = f"--{name.replace('_', '-')}"

    def command(box: Sandbox) -> Words:
        return stage_flags(stage, box, **{name: text})

    return Case(
        "command line: flags of stages", f"{stage} {flag} {text[:30]!r}", command, (flag, name), scene=False
    )
