"""The page is aligned plain text of bounded width."""

from egosplat.doctor.findings import WIDTH, Finding, Mark, page

FINDINGS = [
    Finding(Mark.OK, "cores", "2"),
    Finding(Mark.MISSING, "a longer name", "nothing there", "First do this.\nThen do that."),
    Finding(Mark.NOTE, "words", "word " * 60),
]


def test_marks_names_and_values_are_aligned():
    """The page can be read at a glance."""
    lines = page(FINDINGS).splitlines()
    assert lines[0] == "ok       cores          2"
    assert lines[1] == "missing  a longer name  nothing there"
    assert lines[2:4] == [" " * 24 + "First do this.", " " * 24 + "Then do that."]
    assert lines[-1] == "1 thing that this configuration needs: see 'missing'"


def test_long_values_are_wrapped_and_paths_are_not():
    """A path must stay one piece to be copied."""
    path = "/a" * 100
    assert max(map(len, page(FINDINGS).splitlines())) <= WIDTH
    assert path in page([Finding(Mark.OK, "where", f"at {path}")])


def test_the_last_line_says_that_nothing_is_missing():
    """The last line says whether anything is missing."""
    assert page(FINDINGS[:1]).splitlines()[-1] == "Nothing is missing."
