"""A failed run ends with the messages of its failed stages."""

import logging

import pytest
from snakemake.logging import DefaultFormatter
from snakemake_interface_logger_plugins.common import LogEvent

from egosplat.pipeline.snakemake_call import MOST, failures, last_message


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


def report(output: str, log: str) -> str:
    """Snakemake's own text about a job that failed."""
    record = logging.LogRecord("snakemake", logging.ERROR, "", 0, "Error in rule frames", None, None)
    record.event = LogEvent.JOB_ERROR
    about = {"rule_name": "frames", "rule_msg": None, "jobid": 1, "input": ["pictures"], "conda_env": None}
    about |= {"aux": {}, "shellcmd": "egosplat frames --stride 1", "output": [output], "log": [log]}
    record.__dict__.update(about)
    return DefaultFormatter().format(record)


def test_failed_jobs_are_found_in_snakemake_s_log(tmp_path):
    """Each once, also if Snakemake tries it again."""
    (tmp_path / "a.log").write_text("egosplat: a: is wrong")
    log = tmp_path / "snakemake.log"
    reports = [report("results/a.zarr", f"{tmp_path}/a.log")] * 2 + [report("results/b.zarr", "no.log")]
    log.write_text("Building DAG of jobs...\n" + "\n".join(reports) + "\nShutting down\n")
    assert failures(log) == [
        "egosplat: results/a.zarr was not made. a: is wrong",
        "egosplat: results/b.zarr was not made. See no.log",
    ]


def test_the_number_of_reported_failures_is_limited(tmp_path):
    log = tmp_path / "snakemake.log"
    log.write_text("\n".join(report(f"results/{number}.zarr", "no.log") for number in range(MOST + 2)))
    lines = failures(log)
    assert len(lines) == MOST + 1 and lines[-1].startswith("egosplat: 2 more")
