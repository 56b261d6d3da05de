"""The command line: ``--options``, ``--set``, lists of keys and commands, completion; no garbage is looked for among imports."""

import gc
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from egosplat.cli import cli, commands
from egosplat.cli.flags import read_options, without_collection
from egosplat.errors import UserError
from egosplat.pipeline.config import stage_options
from egosplat.pipeline.options import keys_of
from egosplat.pipeline.stages import STAGES
from egosplat.splats.options import SplatsOptions

WITH_KEYS = [stage for stage in STAGES if stage_options(stage)]


def splats(*pairs: str, **given: object) -> SplatsOptions:
    return read_options(SplatsOptions, "splats", given, pairs)


def test_a_word_wins_over_the_values_of_the_rule():
    found = splats("iterations=500", "run.seed=3", "camera.refine_poses=off", iterations=7, sh_degree=1)
    assert (found.iterations, found.seed, found.refine_poses, found.sh_degree) == (500, 3, "off", 1)
    assert splats() == SplatsOptions()
    given = SplatsOptions(max_points=20, masking="none").as_dict()
    assert splats(**json.loads(json.dumps(given, sort_keys=True))).as_dict() == given


@pytest.mark.parametrize(
    "given, pairs, message",
    [
        ({}, ["iteratons=5"], "--set.*'iteratons'.*'iterations'"),
        ({}, ["iterations=big"], "--set.*splats.iterations = 'big'.*whole number"),
        ({}, ["seed=-1"], "--set.*run.seed = -1.*at least 0"),
        ({}, ["masking=nones"], "--set.*splats.masking = 'nones'.*'none'"),
        ({}, ["run.near_plane=.nan"], "--set.*run.near_plane = nan"),
        ({}, ["iterations"], "--set.*iterations"),
        ({}, ["iterations=["], "--set.*cannot be read"),
        ([1], [], "--options"),
    ],
)
def test_a_wrong_word_and_options_that_are_no_object_are_named(given, pairs, message):
    with pytest.raises(UserError, match=message) as caught:
        read_options(SplatsOptions, "splats", given, pairs)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("stage", WITH_KEYS)
def test_help_lists_the_keys_but_readings_of_the_paper(stage):
    keys = keys_of(stage_options(stage))
    shown = CliRunner().invoke(cli, [stage.replace("_", "-"), "--help"]).output
    found = {line.split()[0] for line in shown.partition("Keys:")[2].splitlines() if line.strip()}
    assert {*keys} & found == {name for name, key in keys.items() if not key.get("reading")}


@pytest.mark.parametrize("name", ["stdin", "stdout", "stderr"])
def test_a_closed_stream_leads_nowhere(monkeypatch, name):
    """Otherwise the progress of a stage, which looks for a terminal, is a traceback."""
    monkeypatch.setattr(sys, name, None)
    commands._open_closed_streams()
    with getattr(sys, name) as opened:
        assert opened.name == os.devnull and not opened.isatty()


@pytest.fixture
def collecting():
    """Other tests find the collector as this one did."""
    enabled = gc.isenabled()
    gc.enable()
    yield
    (gc.enable if enabled else gc.disable)()


def test_libraries_are_imported_without_search_for_garbage_and_frozen_then(collecting):
    before = gc.get_freeze_count()
    with without_collection():
        assert not gc.isenabled()
        kept = [[number] for number in range(100)]
    assert gc.isenabled() and gc.get_freeze_count() >= before + len(kept)


def test_a_command_frees_no_objects_one_by_one_when_it_ends():
    """Python's last search came after what was registered first: it finds everything frozen."""
    code = "import atexit, gc; atexit.register(lambda: print(len(gc.get_objects())))\n"
    words = [sys.executable, "-c", f"{code}from egosplat.cli import main; main()", "snakefile"]
    assert int(subprocess.check_output(words, text=True).splitlines()[-1]) < 1000


def said(*words: str) -> str:
    done = CliRunner(env={"COLUMNS": "80"}).invoke(cli, words)
    assert done.exit_code == 0, done.output
    return done.output


def test_commands_are_listed_by_group_on_one_line_each():
    text = said("--help")
    order = ("Make a scene:", "Ask and look:", "  query ", "Set up:", "  doctor ", "Stages", "  splats ")
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert max(map(len, text[places[0] :].splitlines())) <= 80 and "..." not in text[places[0] :]


@pytest.mark.parametrize("command", ["query", "catalog", "page", "view", "export", "movie"])
def test_keys_stand_behind_set(command):
    text = said(command, "--help")
    assert "--set" in text and "temperature" not in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("egosplat exp", "export"),
        ("egosplat export x --for", "--format"),
        ("egosplat export x --format sp", "spz"),
    ],
)
def test_bash_completes(words, expected):
    asked = {"_EGOSPLAT_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    command = Path(sys.executable).with_name("egosplat")
    done = subprocess.run([command], env=os.environ | asked, capture_output=True, text=True, check=True)
    assert done.stdout == f"plain,{expected}\n"
