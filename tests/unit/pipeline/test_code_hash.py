"""The code hash changes with executed code only."""

import sys
import textwrap
from pathlib import Path

import pytest

from egosplat.pipeline import code_hash as fingerprint
from egosplat.pipeline import parsed_modules
from egosplat.pipeline.code_hash import code_hash, modules_of
from egosplat.pipeline.stages import STAGES, code_of

PACKAGE = Path(fingerprint.__file__).parents[1]

FILES = {
    "__init__": "",
    "stage": '"""A stage."""\nfrom pkg import helper\n\ndef run(x):\n    """Run."""\n    return helper.double(x)\n',
    "helper": "def double(x):\n    return 2 * x\n",
    "other": "def triple(x):\n    return 3 * x\n",
}


CACHED = (
    fingerprint._find,
    parsed_modules.parse_module,
    fingerprint._cached_cpp,
    fingerprint._cached_scripts,
)


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "pkg"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(**changes: str) -> str:
        for name, text in (FILES | changes).items():
            (folder / f"{name}.py").write_text(textwrap.dedent(text))
        for cached in CACHED:
            cached.cache_clear()
        return code_hash("pkg.stage")

    yield write
    for name in [name for name in sys.modules if name.partition(".")[0] == "pkg"]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "change",
    [
        {"helper": "# why\ndef double(x):\n    return 2 * x  # twice\n"},
        {"helper": '"""Now documented."""\n\n\ndef double(x):\n    """Twice."""\n    return 2 * x\n'},
        {"helper": "def double(x):\n\n    return (2\n            * x)\n"},
        {"other": "def triple(x):\n    return 4 * x\n"},
    ],
    ids=["comment", "docstring", "layout", "unrelated module"],
)
def test_code_outside_the_import_closure_does_not_change_the_hash(package, change):
    assert package() == package(**change)


@pytest.mark.parametrize(
    "change",
    [
        {"helper": "def double(x):\n    return 2.0 * x\n"},
        {"helper": "def double(x, y=1):\n    return 2 * x\n"},
        {"__init__": "import math\n"},
        {"stage": "def run(x):\n    from pkg import other\n    return other.triple(x)\n"},
    ],
    ids=["constant", "default", "parent package", "import in a function"],
)
def test_code_inside_the_import_closure_changes_the_hash(package, change):
    assert package() != package(**change)


MESSAGES = """\
def double(x, log, name):
    log(f"doubles {x} of {name}" + (" again" if x > 2 else ""))
    if x < 0:
        raise UserError(f"{x}: negative. Give {name + 1} or more.")
    raise ValueError("not a number")
"""


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("doubles", "takes twice", True),
        (" again", " once more", True),
        ("negative. Give", "below 0; give", True),
        ('"not a number"', '"infinite", "or not a number"', True),
        ("{name + 1}", "{name + 2}", False),
        ("x > 2", "x > 3", False),
        ("ValueError", "TypeError", False),
    ],
)
def test_of_a_message_only_what_it_computes_changes_the_hash(package, old, new, same):
    assert (package(helper=MESSAGES) == package(helper=MESSAGES.replace(old, new))) == same


OPTIONS = """\
class HelperOptions(Options):
    iterations: Count = 3000

    @property
    def doubled(self):
        return 2 * self.iterations
"""


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("3000", "7000", True),
        ("Count = 3000", "Natural = 3000\n    seed: int = 0", True),
        ("2 *", "3 *", False),
        ("(Options)", "", False),
        ("class Helper", "class OtherOptions(Options):\n    size: int = 1\n\n\nclass Helper", True),
    ],
)
def test_of_options_the_keys_do_not_count(package, old, new, same):
    """Their values are parameters of the rule."""
    assert (package(helper=OPTIONS) == package(helper=OPTIONS.replace(old, new))) == same


def test_a_template_beside_a_module_that_is_reached_counts(package, tmp_path):
    files = {"pages/__init__": "", "pages/story": "X = 1\n", "stage": "from pkg.pages import story\n"}
    (tmp_path / "pkg/pages").mkdir(parents=True)
    template = tmp_path / "pkg/pages/story.html.j2"
    template.write_text("<p>")
    first = package(**files)
    template.write_text("<div>")
    assert package(**files) != first
    other = files | {"stage": "import pkg.pages\n"}
    first = package(**other)
    template.write_text("<p>")
    assert package(**other) == first


KERNELS = {
    "stage": "def run(x):\n    from pkg.kernels import library\n    return library.load(x)\n",
    "kernels/__init__": "",
    "kernels/library": "def load(x):\n    return x\n",
}
CPP = "// Twice.\nfloat twice(float x) { return 2.0f * x; }\n"


def with_sources(package, folder, text: str, **changes: str) -> str:
    """The stage's hash when ``text`` is one of the sources of the package's kernels."""
    (folder / "pkg/kernels/source").mkdir(parents=True, exist_ok=True)
    (folder / "pkg/kernels/source/part.h").write_text(text)
    return package(**(KERNELS | changes))


def test_the_sources_of_a_package_that_is_reached_count(package, tmp_path):
    first = with_sources(package, tmp_path, CPP)
    assert with_sources(package, tmp_path, CPP.replace("2.0f", "2.5f")) != first
    assert with_sources(package, tmp_path, "/* Two times. */\n" + CPP.replace("{ ", "{\n    ")) == first


def test_library_versions_change_the_hash():
    assert code_hash("egosplat.geometry") != code_hash("egosplat.geometry", libraries=("numpy",))


def test_every_stage_reaches_its_own_room_and_not_another_stage():
    for name, stage in STAGES.items():
        modules = set(modules_of(stage.module))
        assert stage.module in modules
        others = {other.module for key, other in STAGES.items() if key != name}
        assert not modules & others, f"{name} imports another stage"
        assert len(code_of(name)) == 16


def test_every_template_and_table_is_code_of_a_page():
    pages = [stage.module for stage in STAGES.values()]
    pages += [f"egosplat_rivals.{name}.stage" for name in ("tables", "tradeoff")] + ["egosplat.report.story"]
    folders = {path.parent for page in pages for path in modules_of(page).values() if path.stem != "__init__"}
    texts = [path for path in PACKAGE.rglob("*") if path.suffix in fingerprint.TEXTS]
    assert texts and {path.parent for path in texts} <= folders
