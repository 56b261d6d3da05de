"""Run a command of ``egosplat`` in this process."""

import sys

import pytest

from egosplat import cli


def run_command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *words: object
) -> tuple[int, str, str]:
    """Exit status, what it printed, and what it complained of."""
    monkeypatch.setattr(sys, "argv", ["egosplat", *map(str, words)])
    status = 0
    try:
        cli.main()
    except SystemExit as end:
        status = int(end.code or 0)
    printed = capfd.readouterr()
    return status, printed.out, printed.err
