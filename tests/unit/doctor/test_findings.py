"""The page is aligned plain text."""

from egosplat.doctor.findings import Finding, Mark, page

FINDINGS = [
    Finding(Mark.OK, "cores", "2"),
    Finding(Mark.MISSING, "a longer name", "nothing there", "First do this.\nThen do that."),
]


def test_marks_names_and_values_are_aligned():
    lines = page(FINDINGS).splitlines()
    assert lines[0] == "ok       cores          2"
    assert lines[1] == "missing  a longer name  nothing there"
    assert lines[2:4] == [" " * 24 + "First do this.", " " * 24 + "Then do that."]
    assert page(FINDINGS[:1]).splitlines()[-1] == "Nothing is missing."
    assert lines[-1] == "1 thing that this configuration needs: see 'missing'"
