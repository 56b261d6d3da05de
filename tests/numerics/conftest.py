"""The cases of the numerics tests: what each of them says of itself, the errors it measures, and the table of both. A test says with
``@pytest.mark.numerics(tried, within=..., outside=...)`` what it tries, within which error of a float64 reference the results stay, and
what happens there or beyond the range. It gives each error to the fixture ``measured``, which holds it against that bound. ``pytest
tests/numerics --numerics-table docs/numerics.md`` writes what came out."""

from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from egosplat.rasterize.kernels import library

settings.register_profile(
    "numerics",
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    # Fixtures of swept tests build new objects, or only collect.
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
settings.load_profile("numerics")

AREAS = {
    "artifacts": "Artifacts",
    "rasterize": "Rasterizer",
    "instances": "Instances merged in 3D",
    "features": "Consistent features and compression",
    "query": "Relevancy and answers",
    "histories": "Carries",
    "transient": "Transient network and masks",
    "poses": "Poses",
    "camera": "Camera of synthetic recordings",
    "gaussians": "Training",
    "models": "SAM2 and OpenCLIP",
    "chain": "Whole scenes",
    "library": "The library",
}
"""By the folder of the tests; the table's order."""

HEADER = """# Numbers at their extremes

`make numerics` runs the cases of `tests/numerics`, and writes this page. {machine}

- **Input**: a range that [Hypothesis](https://hypothesis.readthedocs.io) samples, or one value of each decade.
- **Error**: the largest difference to a float64 reference with the same float32 inputs, and in brackets the limit of the test.
  It is absolute for images, probabilities and relevancies. It is relative for gradients and positions (L2 norm of all values of a kind).
- **Result**: what happens there. "else" is outside of the range. An error names the cause. No result is NaN, except an unknown pose or score.

Pixels are left out where rounding decides whether a Gaussian is composited: alpha within 1e-4 of 1/255, or a transmittance of 1e-4.
"""

NOTES = {
    "Artifacts": "Writing and reading check each number.",
    "Rasterizer": "Errors are of the image and all gradients, if an input does not name one of them.",
    "Carries": "A [carry](answers.md#carries) is the movement of an object by a person.",
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the code hash and waiting for the disk, which take longer than the tests."""
    monkeypatch.setattr("egosplat.artifacts.provenance.code_of", lambda *_: "0")
    monkeypatch.setattr("egosplat.files._sync_one", lambda path: None)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--numerics-table", metavar="PATH", help="write the table of the numerics tests there")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "numerics(tried, within=None, outside=''): a row of docs/numerics.md")


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Callable[[float], None]:
    """``measured(error)``: fails where the error is beyond the bound of the case, or NaN; else remembers it."""
    bound = _case(request.node)["within"]

    def measure(error: float) -> None:
        assert bound is not None, "the case states no bound"
        request.node.user_properties.append(("error", float(error)))
        assert float(error) <= bound, f"error {error:.3g} beyond {bound:g}"

    return measure


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Tell the table which case a test is of."""
    if item.path.parent.name not in AREAS:
        return (yield)
    case = _case(item)
    item.user_properties.append(("case", case))
    result = yield
    measures = any(name == "error" for name, _ in item.user_properties)
    assert measures or case["within"] is None, "the case states a bound and measures no error"
    return result


def _case(node: pytest.Item) -> dict[str, object]:
    """What a test says of itself."""
    mark = node.get_closest_marker("numerics")
    assert mark is not None, f"{node.nodeid} has no numerics mark"
    tried, within, outside = mark.args[0], mark.kwargs.get("within"), mark.kwargs.get("outside", "")
    assert within is not None or outside, f"{node.nodeid} says neither a bound nor what happens"
    return {"area": AREAS[node.path.parent.name], "tried": tried, "within": within, "outside": outside}


class Table:
    """Collects the reports of a run and writes them as Markdown."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[tuple[str, str], dict[str, object]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        case = dict(report.user_properties).get("case")
        if report.when != "teardown" or case is None:
            return
        row = self._rows.setdefault((case["area"], case["tried"]), case | {"errors": []})
        row["errors"] += [value for name, value in report.user_properties if name == "error"]

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        # After a failed run the table would be wrong.
        if exitstatus == 0:
            self._path.write_text(self._text(), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter, exitstatus: int) -> None:
        written = (
            f"{len(self._rows)} cases in {self._path}" if exitstatus == 0 else "the table is not written"
        )
        terminalreporter.write_line(written)

    def _text(self) -> str:
        parts = [HEADER.format(machine=_machine())]
        for area in AREAS.values():
            rows = [row for (where, _), row in self._rows.items() if where == area]
            if rows:
                note = f"{NOTES[area]}\n\n" if area in NOTES else ""
                head = "|input|error|result|\n|---|---|---|\n"
                parts.append(f"## {area}\n\n{note}{head}{''.join(map(_line, rows))}")
        return "\n".join(parts)


def pytest_sessionstart(session: pytest.Session) -> None:
    path = session.config.getoption("--numerics-table", default=None)
    if path and not hasattr(session.config, "workerinput"):
        session.config.pluginmanager.register(Table(Path(path)), "numerics-table")


def _machine() -> str:
    return f"Its kernels: {library.variant() if library.is_usable() else 'none'}."


def _line(row: dict[str, object]) -> str:
    """A case, its largest error and bound where it has them, and what happens beyond."""
    error = f"{_short(max(row['errors']))} ({_short(row['within'])})" if row["errors"] else ""
    return f"|{row['tried']}|{error}|{row['outside']}|\n"


def _short(number: float) -> str:
    """One digit: 3e-6; 0 where it is exactly that."""
    return f"{number:.0e}".replace("e-0", "e-").replace("e+00", "") if number else "0"
