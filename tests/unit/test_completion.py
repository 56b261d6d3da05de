"""The shell completes commands, flags and choices, as docs/index.md says."""

import sys

import pytest

from egosplat import cli


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("egosplat exp", "export"),
        ("egosplat export x --for", "--format"),
        ("egosplat export x --format sp", "spz"),
    ],
)
def test_bash_completes(words, expected, monkeypatch, capfd):
    monkeypatch.setenv("_EGOSPLAT_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    monkeypatch.setattr(sys, "argv", ["egosplat"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert (end.value.code, capfd.readouterr().out) == (0, f"plain,{expected}\n")
