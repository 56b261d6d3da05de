"""No rule that trains depends on annotations; scenes for reporting run only by name."""

import re

import pytest

EVALUATION = {"all", "contact_sheet", "metrics", "queries_sheet", "tables", "story", "tradeoff"}
"""Rules that may read annotations. Every other rule counts as training."""


def edges(unchanged, *targets: str) -> set[tuple[str, str]]:
    """Pairs (rule, rule that depends on it) of the whole DAG."""
    done = unchanged.snakemake("--rulegraph", "--forceall", "--", *targets)
    assert done.returncode == 0, done.stderr
    names = dict(re.findall(r'(\d+)\[label = "([^"\\]+)', done.stdout))
    found = {(names[a], names[b]) for a, b in re.findall(r"(\d+) -> (\d+)", done.stdout)}
    assert ("frames", "poses") in found, done.stdout
    return found


def descendants(of: str, pairs: set[tuple[str, str]]) -> set[str]:
    found: set[str] = set()
    todo = [of]
    while todo:
        rule = todo.pop()
        following = {after for before, after in pairs if before == rule} - found
        found |= following
        todo.extend(following)
    return found


def test_no_rule_that_trains_sees_annotations(unchanged):
    pairs = edges(unchanged, "all")
    assert {"contact_sheet", "metrics"} <= descendants("annotations", pairs)
    assert ("language", "metrics") in pairs
    assert descendants("annotations", pairs) <= EVALUATION


def test_apartments_for_reporting_are_made_by_name_alone(unchanged):
    """A run of everything leaves them out; asked for by name they are filmed, whatever the root."""
    everything = unchanged.snakemake("--dry-run", "--", "all")
    assert everything.returncode == 0, everything.stderr
    planned = everything.stdout + everything.stderr
    assert "results/adt/scene2/metrics.json" in planned and "results/adt/scene6/" not in planned
    root = "data_root={adt: " + str(unchanged.folder / "config") + "}"
    one = unchanged.snakemake("--dry-run", "--config", root, "--", "results/adt/scene6/metrics.json")
    assert one.returncode == 0, one.stderr
    assert "results/adt/scene6/recording" in one.stdout + one.stderr


@pytest.mark.parametrize(
    "target, said",
    [
        ("adt/scene99/metrics.json", "no scene adt/scene99"),
        ("adt/scene1/variants/nope/metrics.json", "no variant 'nope'"),
        ("hoi4d/scene1/metrics.json", "hoi4d/scene1: no recording at "),
    ],
)
def test_a_scene_or_variant_that_is_not_there_gets_one_line(unchanged, target, said):
    done = unchanged.snakemake("--dry-run", "--", f"results/{target}")
    assert done.returncode == 1 and "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("egosplat: ")]
    assert said in line


def test_the_tables_hold_scores_of_apartments_for_reporting_once_they_are_there(workdir):
    """Without them, no apartment is filmed for the tables; with them, they are an input."""

    def plan() -> str:
        few = ("--config", "tables={methods: []}")
        done = workdir.snakemake("--dry-run", *few, "--", "results/benchmark/tables.html")
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    assert "adt/scene7" not in plan()
    scores = workdir.folder / "results/adt/scene7/metrics.json"
    scores.parent.mkdir(parents=True)
    scores.write_text("{}")
    assert "results/adt/scene7/metrics.json" in plan()
