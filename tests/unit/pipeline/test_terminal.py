"""The terminal shows a line for each step, and a failed run ends with the messages of its failed stages."""

import logging

import pytest
from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.common import LogEvent

from egosplat.pipeline.terminal import MOST, PlainOutput, Step, StepTimes, last_message, speak_plainly


@pytest.mark.parametrize(
    "text, message",
    [
        ("egosplat: a: is wrong\n", "a: is wrong"),
        ("reading 3 of 5\negosplat: a: is wrong.\nDo b\n", "a: is wrong.\nDo b"),
        ("egosplat: one\negosplat: two\n", "two"),
        ("Traceback (most recent call last):\nValueError: x\n", "See {log}"),
        ("says egosplat: in a line\n", "See {log}"),
        ("", "See {log}"),
        (None, "See {log}"),
    ],
)
def test_the_last_message_of_the_log_is_shown(tmp_path, text, message):
    log = tmp_path / "stage.log"
    if text is not None:
        log.write_text(text)
    assert last_message(log) == message.format(log=log)


def failed(output: str, log: str) -> logging.LogRecord:
    """Snakemake's record of a job that failed."""
    record = logging.LogRecord("snakemake", logging.ERROR, "", 0, "Error in rule frames", None, None)
    record.event = LogEvent.JOB_ERROR
    about = {"rule_name": "frames", "rule_msg": None, "jobid": 1, "input": ["pictures"], "conda_env": None}
    about |= {"aux": {}, "shellcmd": "egosplat frames --stride 1", "output": [output], "log": [log]}
    record.__dict__.update(about)
    return record


def test_a_failed_job_is_shown_without_its_shell_command():
    short, record = PlainOutput(DefaultFormatter()), failed("results/a.zarr", "a.log")
    text = short.format(record)
    assert "Error in rule frames" in text and "a.log" in text and "--stride" not in text
    assert record.shellcmd == "egosplat frames --stride 1", "Snakemake's log file is written from it"
    assert short.failed == {"results/a.zarr": "a.log"}


def test_a_failed_shell_command_is_reported_once():
    short = PlainOutput(DefaultFormatter())
    for text, kept in (("RuleException:\nCalledProcessError in file x", False), ("WorkflowError:\nx", True)):
        record = logging.LogRecord("snakemake", logging.ERROR, "", 0, text, None, None)
        record.event = LogEvent.ERROR
        assert short.format(record) == (text if kept else "")


def test_the_number_of_reported_failures_is_limited(capsys):
    short = PlainOutput(DefaultFormatter())
    for number in range(MOST + 2):
        short.format(failed(f"results/{number}.zarr", "no.log"))
    short._tell()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == MOST + 1 and lines[-1] == "egosplat: 2 more were not made; see above"


def test_only_the_terminal_is_shortened():
    terminal, file = logging.StreamHandler(), logging.StreamHandler()
    terminal.name, file.name = "DefaultStreamHandler", "DefaultLogFileHandler"
    for handler in (terminal, file):
        handler.setFormatter(DefaultFormatter())
    short = speak_plainly([file, terminal])
    assert terminal.formatter is short and isinstance(file.formatter, DefaultFormatter)
    assert speak_plainly([file]) is None


def record(event: LogEvent | None, text: str = "", **about: object) -> logging.LogRecord:
    made = logging.LogRecord("snakemake", logging.INFO, "", 0, text, None, None)
    made.event = event
    made.__dict__.update(about)
    return made


def step(rule: str, scene: str = "scene1", variant: str = "") -> Step:
    return Step.of(rule, {"dataset": "adt", "scene": scene, "variant": variant})


def begun(job: int, one: Step, output: str) -> logging.LogRecord:
    about = {"jobid": job, "rule_name": one.rule, "wildcards": dict(one.wildcards)}
    return record(LogEvent.JOB_INFO, output=[output], **about)


def test_a_step_is_one_line_with_the_time_that_is_left():
    """Frames were expected to take 30 s and take 60: the rest is expected to take twice as long, too."""
    now = [0.0]
    plain = PlainOutput(DefaultFormatter())
    expected = {step("frames"): 30.0, step("poses"): 10.0, step("splats"): 300.0}
    plain.times = StepTimes(expected.get, lambda: expected, lambda: now[0])
    assert plain.format(record(LogEvent.RUN_INFO, "a table", stats={})) == "3 steps, about 6 min left"
    frames = begun(7, step("frames"), "results/frames.zarr")
    assert plain.format(frames) == "[1/3] frames: results/frames.zarr, about 6 min left"
    now[0] = 60.0
    assert plain.format(record(LogEvent.JOB_FINISHED, "Finished jobid: 7", job_id=7)) == ""
    assert plain.format(record(LogEvent.PROGRESS, done=1, total=3)) == ""
    poses = begun(8, step("poses"), "results/poses.zarr")
    assert plain.format(poses) == "[2/3] poses: results/poses.zarr, about 10 min left"


def test_a_step_takes_the_time_of_its_own_scene_and_variant():
    """Steps of one rule differ: a variant's method may take minutes where the scene's own takes seconds."""
    steps = [step("language"), step("language", variant="variants/slow/"), step("language", "scene2")]
    expected = dict(zip(steps, (10.0, 600.0, 60.0), strict=True))
    plain = PlainOutput(DefaultFormatter())
    plain.times = StepTimes(expected.get, lambda: steps, lambda: 0.0)
    assert plain.format(record(LogEvent.RUN_INFO, stats={})) == "3 steps, about 11 min left"
    assert plain.format(begun(1, steps[1], "slow.zarr")).endswith("about 11 min left")
    plain.format(record(LogEvent.JOB_FINISHED, job_id=1))
    assert plain.times.left_s() == pytest.approx(0.0)  # all was done in no time
    fresh = StepTimes(expected.get, lambda: steps, lambda: 0.0)
    fresh.plan()
    fresh.begin(1, steps[0])
    fresh.finish(1)
    assert fresh.left_s() == 660.0


def test_steps_that_were_not_planned_are_counted():
    plain = PlainOutput(DefaultFormatter())
    plain.times = StepTimes(lambda one: None, lambda: [step("survey")])
    plain.format(record(LogEvent.RUN_INFO, stats={}))
    for number, rule in enumerate(("survey", "transient"), 1):
        line = plain.format(begun(number, step(rule), f"{rule}.zarr"))
        assert line == f"[{number}/{number}] {rule}: {rule}.zarr"


def test_lines_of_snakemake_about_itself_are_left_out_and_warnings_stay():
    plain = PlainOutput(DefaultFormatter())
    plain.times = StepTimes(lambda one: None, list)
    assert plain.format(record(None, "Building DAG of jobs...")) == ""
    assert plain.format(record(None, "Nothing to be done (all requested files are present).")) != ""
    assert plain.format(record(LogEvent.PROGRESS, done=3, total=3)) == "3 of 3 steps (100%) done"


def test_a_dry_run_shows_snakemake_s_own_blocks():
    plain = PlainOutput(DefaultFormatter())
    assert plain.format(record(LogEvent.PROGRESS, done=1, total=3)) == "1 of 3 steps (33%) done"
