"""No rule that trains depends on annotations; scenes for reporting run only by name; another workflow may deploy this one."""

import pytest

from benchmarks.ledger import __main__ as ledger
from egosplat.pipeline.variants import variant_folder

EVALUATION = {"all", "contact_sheet", "metrics", "queries_sheet", "tables", "story", "tradeoff"}
"""Rules that may read annotations. Every other rule counts as training."""


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
    pairs = unchanged.edges("--rulegraph", "--forceall", "--", "all")
    assert ("frames", "poses") in pairs
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
        ("adt/scene99/frames.zarr", "no scene adt/scene99"),
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


MODULE = """
configfile: "config/config.yaml"

module egosplat:
    snakefile: "{}"
    config: config

use rule * from egosplat{}
"""


@pytest.mark.parametrize("prefix", ["", " as ego_*"])
def test_another_workflow_deploys_this_one_as_a_module(workdir, prefix):
    """What is finished stays so, what is lost is made again, and the survey decides what is needed."""
    tiny, scene = workdir.folder / "tiny.yaml", "results/adt/scene1"
    tiny.write_text(tiny.read_text().replace("masking: refined", "masking: auto"))
    (workdir.folder / scene / "splats.png").unlink()
    snakefile, workdir.snakefile = workdir.snakefile, workdir.folder / "Snakefile"
    workdir.snakefile.write_text(MODULE.format(snakefile, prefix))
    assert "2 of 2 steps" in workdir.run(f"{scene}/survey.json", f"{scene}/splats.png")
    assert workdir.stale(*workdir.MAIN) == set()


def test_every_setting_of_a_drawn_apartment_can_be_made(tmp_path, capfd):
    """The plan has the scores of each setting, and one recording for all of them."""
    settings = ledger.SETTINGS
    ledger.prepare(tmp_path, {"busy1": ledger.draw_seeds("a text", count=1)[0]})
    folders = [variant_folder(variant) for variant in settings.values()]
    targets = [f"results/ledger/busy1/{folder}metrics.json" for folder in folders]
    assert ledger.snakemake(tmp_path, 1, targets, "--dry-run", "--quiet", "rules") == 0
    planned = capfd.readouterr().err
    counts = dict(line.split() for line in planned.splitlines() if len(line.split()) == 2)
    assert counts["metrics"] == str(len(settings)) and counts["synthetic"] == "1"
