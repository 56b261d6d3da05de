"""Snakemake's lines become one line a step, with the time that is left; a failure becomes its own message."""

import os

import pytest

from egosplat.pipeline.config import defaults
from egosplat.run import steps as module
from egosplat.run.command import put_row
from egosplat.run.steps import Forecast, Steps, describe, machine_pace
from tests.unit.pipeline.test_failed_stages import report

BEFORE = """\
Building DAG of jobs...
egosplat: mine/kitchen: the small checkpoints are small
Provided cores: 2
Job stats:
job         count
--------  -------
frames          1
poses           1
splats          1
total           3

Select jobs to execute...
"""


def begun(step: str) -> str:
    return f"Execute 1 jobs...\n\n[Fri Nov 27 14:31:24 2026]\nlocalrule {step}:\n    output: results/{step}.zarr\n    jobid: 1\n"


def ended(step: str, done: int, total: int = 3) -> str:
    return (
        f"[Fri Nov 27]\nFinished jobid: 1 (Rule: {step})\n{done} of {total} steps ({done / total:.0%}) done\n"
    )


class Known:
    """A forecast: each step takes ten seconds on an idle machine."""

    count: int | None = 12

    def steps(self):
        return ["frames", "poses", "survey", "splats", "language"]

    def seconds(self, step):
        return 10.0


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def run():
    """``run(text, seconds)``: the lines for the user, of Snakemake's text after some seconds; and the steps."""
    clock = Clock()
    steps = Steps(Known(), 2.0, clock)

    def read(text, seconds=0.0):
        clock.now += seconds
        return [line for part in text.splitlines() for line in steps.read(part)]

    return read, steps


def test_the_workflow_s_own_lines_and_the_plan_come_first(run):
    read, steps = run
    notice, plan = read(BEFORE)
    assert notice == "mine/kitchen: the small checkpoints are small"
    assert plan.startswith("3 steps; about 60 s")
    assert steps.remaining_s() == 60


def test_frames_that_are_not_counted_yet_give_no_time(run, monkeypatch):
    monkeypatch.setattr(Known, "count", None)
    assert "about" not in run[0](BEFORE)[1]


def test_each_step_is_one_line_when_it_ends(run):
    read, _ = run
    read(BEFORE)
    assert read(begun("frames") + "frames: reading: 3 of 4\nposes    3\n") == []
    assert read(ended("frames", 1), 20) == [f" 1/3 frames: {describe('frames')}, 20 s; about 40 s left"]
    assert read(begun("poses") + begun("splats")) == []
    (line,) = read(ended("splats", 2), 30)
    assert line.startswith(" 2/3 splats: ") and ", 30 s; " in line
    (last,) = read(ended("poses", 3), 2)
    assert last.endswith(", 32 s")


def test_the_pace_of_the_steps_replaces_that_of_the_machine(run):
    read, steps = run
    read(BEFORE + begun("frames"))
    read(ended("frames", 1), 100)
    # Ten expected seconds took 100, and 20 count at the pace of the machine.
    assert steps.remaining_s() == pytest.approx(20 * (20 * 2 + 100) / 30)
    read(begun("poses"))
    read("", 1000)
    assert steps.remaining_s() == pytest.approx(1.1 * 10 * 140 / 30)


def test_what_a_survey_may_still_ask_for_is_expected(run):
    read, steps = run
    read(BEFORE.replace("poses ", "survey"))
    assert steps.remaining_s() == 2 * 10 * 5


@pytest.mark.parametrize("log", ["told", "silent"])
def test_a_failed_step_gives_its_message_and_its_log(run, tmp_path, log):
    read, steps = run
    path = tmp_path / "poses.log"
    if log == "told":
        path.write_text("reading\negosplat: clip.mp4: the camera stands still.\nMove it\n")
    failure = report("results/poses.zarr", str(path)).replace("frames", "poses")
    assert read(BEFORE + begun("poses") + failure + failure) == [
        "mine/kitchen: the small checkpoints are small"
    ] + ["3 steps; about 60 s on processors as busy as these are"]
    told = steps.explain()
    assert told.splitlines()[-1] == f"The whole log: {path}"
    assert told.startswith(
        "poses: clip.mp4: the camera stands still.\nMove it\n" if log == "told" else "poses: See "
    )


def test_a_killed_step_is_said_to_be_killed(run, tmp_path):
    """Its log has no message; the shell around it has one."""
    read, steps = run
    failure = report("results/poses.zarr", str(tmp_path / "poses.log")).replace("frames", "poses")
    assert not read(begun("poses") + "egosplat: the stage was killed\n" + failure)
    assert steps.explain().startswith("poses: the stage was killed\n")


@pytest.mark.parametrize(
    "text, said",
    [
        ("Building DAG\negosplat: config: key a is wrong\n", "config: key a is wrong"),
        ("egosplat: mine/kitchen: a notice\negosplat: a: is wrong.\nDo b\n", "a: is wrong.\nDo b"),
        (
            "LockException:\nError: Directory cannot be locked.\n",
            "LockException:\nError: Directory cannot be locked.",
        ),
    ],
)
def test_a_run_that_does_not_begin_says_why(run, text, said):
    read, steps = run
    read(text)
    assert steps.explain() == said


def test_a_run_without_work_says_so(run):
    assert run[0]("Nothing to be done (all requested files are present and up to date).\n") == [
        "every step is up to date"
    ]


@pytest.mark.parametrize(
    "load, cores, pace", [(0.0, 2, 1.0), (2.0, 2, 2.0), (6.0, 2, 4.0), (0.0, 1, 2.0), (6.0, 1, 7.0)]
)
def test_a_busy_machine_takes_longer(monkeypatch, load, cores, pace):
    """On two processors; a load of 6 leaves two of our own a quarter."""
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0, 0))
    monkeypatch.setattr(module.os, "cpu_count", lambda: 2)
    assert machine_pace(cores) == pace


def test_more_frames_and_missing_poses_take_longer(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    row = {
        "dataset": "mine",
        "scene": "k",
        "format": "plain",
        "recording": "k.mp4",
        "options": "frames.stride=2",
    }
    scene = put_row(defaults(), row)
    few, many, known = Forecast(scene, 100, False), Forecast(scene, 1000, False), Forecast(scene, 100, True)
    assert {"frames", "poses", "language"} <= {*few.steps()} and few.steps()[-1] == module.GOAL
    assert few.seconds("segments") < many.seconds("segments")
    assert known.seconds("poses") < few.seconds("poses")
    assert Forecast(scene, None, True).seconds("frames") > many.seconds("frames")
