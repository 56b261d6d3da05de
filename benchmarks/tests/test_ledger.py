"""The ledger: which apartments a text draws, what may run, and which scores enter."""

import csv
import re
import subprocess
import time
from dataclasses import replace

import pytest
import yaml
from click.testing import CliRunner

from benchmarks import rows
from benchmarks.common import ROOT
from benchmarks.ledger import __main__ as ledger
from benchmarks.tests.test_ablation import OPTIONS, answered
from egosplat.errors import UserError
from egosplat.pipeline.process_guards import STARTED_BY
from tests.support.rows import SCENES, some_rows
from training.small_models.worlds import HELD_OUT_SEEDS, TRAINING_SEEDS

COMMIT = "c0de" * 10


def register(*lines: str) -> None:
    """Commit a list of these texts."""
    listed = ["text\tregistered\tscores\twhy", *(f"{line}\t2026-01-01\tchanged\t{line}" for line in lines)]
    (ledger.LEDGER / rows.TEXTS).write_text("".join(f"{line}\n" for line in listed))
    for words in ("init -q", "add .", "-c user.name=a -c user.email=b commit -q --allow-empty -m a"):
        subprocess.run(["git", *words.split()], cwd=ledger.LEDGER, check=True)


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A clean checkout with a ledger that registers ``mine``; ``checkout(clean=)`` changes it."""

    def be(clean: bool | None = True) -> None:
        found = {"commit": None if clean is None else COMMIT, "clean": clean}
        monkeypatch.setattr(rows.provenance, "checkout", lambda: found)

    for module in (ledger, rows):
        monkeypatch.setattr(module, "LEDGER", tmp_path / "entries")
    monkeypatch.setattr(ledger, "WORK", tmp_path / "work")
    monkeypatch.setattr(ledger, "snakemake", lambda *_: pytest.fail("ran"))
    ledger.LEDGER.mkdir()
    register("mine")
    be()
    return be


def refused(*words: str) -> str:
    """The one line with which a command ends."""
    done = CliRunner().invoke(ledger.main, [*words])
    assert done.exit_code == 1 and len(done.stderr.splitlines()) == 1
    return done.stderr


def test_a_text_draws_the_same_apartments_for_everybody():
    """The formula of the page; a change of it would change what a text draws."""
    assert ledger.draw_seeds("a text") == ledger.draw_seeds("a text")
    assert ledger.draw_seeds("0.0.0")[:5] == [80647542, 880724794, 262163697, 545730846, 968581997]
    many = {seed for number in range(200) for seed in ledger.draw_seeds(str(number))}
    assert len(many) == 1400


def test_no_apartment_is_drawn_twice():
    first, second, *_ = ledger.draw_seeds("a text")
    assert ledger.draw_seeds("a text", taken={first})[0] == second
    assert ledger.draw_seeds("a text", count=50)[:2] == [first, second]


def test_no_apartment_of_the_repository_can_be_drawn():
    """Scenes, benchmarks, tests and training have smaller seeds; of training, those after its first."""
    most_worlds = 1_000_000
    assert max(TRAINING_SEEDS, HELD_OUT_SEEDS) + most_worlds < ledger.FIRST_SEED
    tables = [*ROOT.glob("config/*.tsv"), *ROOT.glob("benchmarks/*/*.tsv"), *ROOT.glob(".test/config/*.tsv")]
    named = [int(seed) for path in tables for seed in re.findall(r"synthetic\.seed=(\d+)", path.read_text())]
    assert len(named) > 50 and max(named) < ledger.FIRST_SEED


def test_a_text_is_committed_before_it_is_run(checkout):
    (ledger.LEDGER / rows.TEXTS).open("a").write("other\t2026-01-01\tsame\tother\n")
    assert "other: is not registered" in refused("other")
    register("mine", "other")
    assert ledger.check_text("other") == COMMIT


@pytest.mark.parametrize("lines", [(), ("yours",), ("yours", "mine")])
def test_a_list_that_lost_a_line_is_refused(checkout, lines):
    register(*lines, "other")
    assert "texts.tsv: lacks lines of commit" in refused("other")


def test_a_second_run_is_refused(checkout):
    rows.write_rows(ledger.LEDGER / "mine", some_rows())
    assert "mine: was run already" in refused("mine")


@pytest.mark.parametrize("clean", [False, None])
def test_a_checkout_that_is_not_clean_is_refused(checkout, clean):
    checkout(clean)
    assert "no clean checkout" in refused("mine")
    assert not ledger.WORK.exists()


def test_a_failed_run_writes_no_entry_and_goes_on_with_the_same_command(checkout, monkeypatch):
    calls = []
    monkeypatch.setattr(
        ledger, "snakemake", lambda folder, cores, targets: calls.append((folder, targets)) or 1
    )
    for _ in range(2):
        assert "a job failed (exit 1)" in refused("mine", "accurate", "draft")
    assert calls[0] == calls[1] and not (ledger.LEDGER / "mine").exists()
    folder, targets = calls[0]
    assert folder == ledger.WORK / f"mine-{COMMIT[:12]}"
    seeds = ledger.draw_seeds("mine")
    names = [f"{world}{seed}" for world, seed in zip(ledger.DRAW, seeds, strict=True)]
    scene = f"results/ledger/{names[0]}"
    assert {f"{scene}/metrics.json", f"{scene}/variants/draft/metrics.json"} <= set(targets)
    assert f"{scene}/variants/accurate/metrics.json" in targets
    assert len(targets) == len(seeds) * 3
    with (folder / "config/scenes.tsv").open() as table:
        found = {row["scene"]: row["options"].split() for row in csv.DictReader(table, delimiter="\t")}
    assert [*found] == names and [row[0] for row in found.values()] == [f"synthetic.seed={s}" for s in seeds]
    worlds = ["synthetic.world=busy" in row for row in found.values()]
    assert worlds == [world == "busy" for world in ledger.DRAW]
    assert yaml.safe_load((folder / "config/config.yaml").read_text())["synthetic"] == {"camera": "real"}


@pytest.mark.parametrize(
    "changed",
    [{"commit": "beef"}, {"clean": False}, {"artifacts": {"splats.zarr": {"commit": "beef", "clean": True}}}],
)
def test_scores_of_other_code_do_not_enter(changed):
    own = {"commit": COMMIT, "clean": True}
    scene = answered(("cup", True, 0.5))
    scene = replace(scene, document={**scene.document, "provenance": own, "artifacts": {"splats.zarr": own}})
    ledger.check_commit([scene], COMMIT)
    artifacts = changed.pop("artifacts", scene.document["artifacts"])
    other = replace(scene, document={**scene.document, "provenance": own | changed, "artifacts": artifacts})
    with pytest.raises(UserError, match="not made by the clean commit c0dec0dec0de"):
        ledger.check_commit([other], COMMIT)


def test_minutes_hold_the_survey_and_the_start_of_each_process(tmp_path, monkeypatch):
    scene = replace(answered(("cup", True, 0.5)), path=tmp_path / "metrics.json")
    (tmp_path / "survey.json").touch()
    monkeypatch.setattr(rows, "read_document", lambda *_: {"provenance": OPTIONS | {"cpu_s": 7.0}})
    assert rows.collect("mine", {"full": [scene]}).tables["runs"]["cpu_s"].item() == 1.0 + 7.0
    monkeypatch.setenv(STARTED_BY, "1")
    before = time.process_time()
    assert rows.provenance.begin("metrics", {}, "real").cost()["cpu_s"] >= before


def test_the_report_is_computed_from_the_rows_alone(checkout):
    rows.write_rows(ledger.LEDGER / "mine", some_rows())
    register("mine", "other")
    said = CliRunner().invoke(ledger.main, ["--report"], catch_exceptions=False).stdout
    assert said.endswith("# other\n\nRegistered, not run.\n")
    assert said.startswith("# ledger, mine\n\nCommit c0de, a processor, 2 cores, 2026-01-01.")
    assert "| full against other | +" in said and said.count("\n| other | 22 |") == 2
    assert said.count("\n## ") == 4 and said.count("\n| other | 11 |") == 4


def test_texts_are_pooled_from_the_last_change_of_scores_on_that_has_rows(checkout):
    """A setting has the scenes of the texts that ran it."""
    scores = {"old": "changed", "new": "changed", "next": "same", "planned": "changed"}
    lines = [f"{text}\t2026-01-01\t{change}\twhy" for text, change in scores.items()]
    (rows.LEDGER / rows.TEXTS).write_text("\n".join(["text\tregistered\tscores\twhy", *lines]))
    for text in ("old", "new", "next"):
        tables = {name: own.assign(scene=text + own["scene"]) for name, own in some_rows().tables.items()}
        if text == "next":
            tables = {name: own.query("setting == 'full'") for name, own in tables.items()}
        rows.write_rows(rows.LEDGER / text, replace(some_rows(), tables=tables))
    pool = rows.read_source("ledger")
    assert pool.about["name"] == "ledger, new and next"
    asked = {setting: {*pool.of("runs", setting)["scene"]} for setting in pool.settings}
    new, then = ({f"{text}{scene}" for scene in SCENES} for text in ("new", "next"))
    assert asked == {"full": new | then, "other": new}


def test_the_list_of_texts_only_grew_and_every_entry_is_as_it_was_written():
    """Digests of tables, one text a folder, and in the commit that ran, if this clone has it, a registration."""
    texts, page = rows.read_texts(), (rows.LEDGER / "README.md").read_text()
    assert ledger.registered() == texts["text"].to_list()[: len(ledger.registered())]
    assert {path.parent.name for path in rows.LEDGER.glob("*/about.json")} == {*texts.query("ran")["text"]}
    assert set(texts["scores"]) <= {"changed", "same"} and texts["text"].is_unique
    assert all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", text) for text in texts["text"])
    assert all(f"`{text}`, registered, not run" in page for text in texts.query("not ran")["text"])
    for text in texts.query("ran")["text"]:
        entry = rows.read_rows(rows.LEDGER / text)
        about, worlds = entry.about, [*map(rows.world_of, entry.tables["runs"]["scene"].unique())]
        assert worlds in (["usual"] * 5, [*ledger.DRAW])
        show = ["git", "show", f"{about['commit']}:./{rows.TEXTS}"]
        listed = subprocess.run(show, check=False, cwd=rows.LEDGER, capture_output=True, text=True).stdout
        assert about["text"] == text and (f"\n{text}\t" in listed or not listed)
        assert set(about["seeds"]) == set(ledger.draw_seeds(text)[: len(worlds)])
        assert sum(one.stat().st_size for one in (rows.LEDGER / text).iterdir()) < 1_000_000
