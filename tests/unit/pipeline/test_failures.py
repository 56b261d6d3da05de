"""A failed run ends with the messages of its failed stages."""

import logging

import pytest
from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.common import LogEvent

from egosplat.pipeline.failures import MOST, ShortErrors, last_message, shorten_errors


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
    short, record = ShortErrors(DefaultFormatter()), failed("results/a.zarr", "a.log")
    text = short.format(record)
    assert "Error in rule frames" in text and "a.log" in text and "--stride" not in text
    assert record.shellcmd == "egosplat frames --stride 1", "Snakemake's log file is written from it"
    assert short.failed == {"results/a.zarr": "a.log"}


def test_a_failed_shell_command_is_reported_once():
    short = ShortErrors(DefaultFormatter())
    for text, kept in (("RuleException:\nCalledProcessError in file x", False), ("WorkflowError:\nx", True)):
        record = logging.LogRecord("snakemake", logging.ERROR, "", 0, text, None, None)
        record.event = LogEvent.ERROR
        assert short.format(record) == (text if kept else "")


def test_the_number_of_reported_failures_is_limited(capsys):
    short = ShortErrors(DefaultFormatter())
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
    short = shorten_errors([file, terminal])
    assert terminal.formatter is short and isinstance(file.formatter, DefaultFormatter)
    assert shorten_errors([file]) is None
