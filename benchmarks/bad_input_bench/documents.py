"""JSON files that the workflow hands on: scores and surveys."""

import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path

from bad_input_bench.cases import Case, Sandbox, Words, stage_flags
from bad_input_bench.mutations import JSON_RUBBISH, RUBBISH, Break

FAMILY = "documents"


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    for what, change in (RUBBISH | JSON_RUBBISH).items():
        yield _case(
            "metrics.json",
            what,
            change,
            lambda box: ["tables", box.scene / "metrics.json", "--output", "out"],
        )
        yield _case("survey.json", what, change, _follow)
        yield _case("metrics.json", f"{what}, compared", change, _compare)
    odd: dict[str, Callable[[dict], object]] = {
        "another scene": lambda told: told.update(scene="adt/scene2"),
        "a scene with a way up": lambda told: told.update(scene="../../etc"),
        "no scores": lambda told: told.pop("scores"),
        "scores in words": lambda told: told.update(scores="good"),
        "a score above 1": lambda told: told["scores"]["all"].update(accuracy=7),
        "models that are a list": lambda told: told.update(models=[]),
        "a version to come": lambda told: told.update(format_version=99),
    }
    by_path = {
        "a scene with a way up": "the path tells of which scene scores are; no path is made of what they tell"
    }
    for what, change in odd.items():
        yield _case(
            "metrics.json",
            what,
            lambda path, change=change: _change(path, change),
            lambda box: ["tables", box.scene / "metrics.json", "--output", "out"],
            by_path.get(what, ""),
        )
    yield _case("survey.json", "of other frames", _of_other_frames, _follow)
    for text in ("{", "[]", "[1]", "[{}]", '{"a": 1}', "[" * 50_000, "null"):
        yield Case(
            FAMILY,
            f"points of a trade-off {text[:20]!r}",
            lambda _, text=text: ["tradeoff", "--points", text, "--output", "out"],
            ("points", "point"),
        )


def _case(file: str, what: str, change: Break, words: Callable[[Sandbox], Words], fine: str = "") -> Case:
    def command(box: Sandbox) -> Words:
        path = box.scene / file
        change(path)
        return words(box)

    return Case(FAMILY, f"{file}: {what}", command, (file,), fine)


def _follow(box: Sandbox) -> Words:
    return stage_flags("transient", box, survey=box.scene / "survey.json")


def _compare(box: Sandbox) -> Words:
    point = {"settings": [], "metrics": [str(box.scene / "metrics.json")]}
    return ["tradeoff", "--points", json.dumps([point]), "--output", "out"]


def _change(path: Path, change: Callable[[dict], object]) -> None:
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))


def _of_other_frames(path: Path) -> None:
    _change(path, lambda told: told["provenance"]["inputs"].update({"frames.zarr": "0" * 64}))
