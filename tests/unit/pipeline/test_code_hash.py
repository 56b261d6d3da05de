"""The code hash changes with executed code only: modules, C++ sources, scripts and templates."""

import sys
from importlib import metadata
from pathlib import Path

import pytest

from egosplat.pipeline import code_hash as fingerprint
from egosplat.pipeline.code_hash import code_hash, cpp_hash, cpp_tokens, modules_of, scripts_hash
from egosplat.pipeline.parsed_modules import parse_module
from egosplat.pipeline.stages import PIPELINE, STAGES, code_of

HELPER = """\
class HelperOptions(Options):
    iterations: Count = 3000

    @property
    def doubled(self):
        return 2 * self.iterations


def double(x, log, name="cups"):
    log(f"doubles {x} of {name}" + (" again" if x > 2 else ""))
    if x < 0:
        raise UserError(f"{x}: negative. Give {name + 1} or more.")
    raise ValueError("not a number")
"""
STAGE = '''\
"""A stage."""
from pkg import helper
from pkg.pages import story

def run(x):
    """Run."""
    from pkg import kernels, later, templates
    return helper.double(x)
'''
CPP = "// Twice.\nfloat twice(float x) { return 2.0f * x; }\n"
FILES = {
    "__init__.py": "",
    "stage.py": STAGE,
    "helper.py": HELPER,
    "later.py": "LATER = 1\n",
    "other.py": "def triple(x):\n    return 3 * x\n",
    "pages/__init__.py": "",
    "pages/story.py": "X = 1\n",
    "pages/story.html.j2": "<p>",
    "templates/__init__.py": "",
    "templates/page.html.j2": "<p>",
    "kernels/__init__.py": "",
    "kernels/source/part.h": CPP,
}
"""Of the package ``pkg``, by path. Nothing imports ``other``."""

CACHED = (fingerprint._find, parse_module, fingerprint._cached_cpp, fingerprint._cached_scripts)


@pytest.fixture
def stage_hash(tmp_path, monkeypatch):
    """``stage_hash(file, text)``: the hash of the stage with another text of a file."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(file: str = "stage.py", text: str = STAGE) -> str:
        for name, content in (FILES | {file: text}).items():
            path = tmp_path / "pkg" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        for cached in CACHED:
            cached.cache_clear()
        return code_hash("pkg.stage")

    yield write
    for name in [name for name in sys.modules if name.partition(".")[0] == "pkg"]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "file, old, new, same",
    [
        ("helper.py", "def double(", "# why\ndef double(", True),
        ("stage.py", '"""Run."""', '"""Run it."""', True),
        ("stage.py", "helper.double(x)", "(helper\n            .double(x))", True),
        ("other.py", "3 *", "4 *", True),
        ("helper.py", "x > 2", "x > 2.0", False),
        ("helper.py", '="cups"', '="mugs"', False),
        ("__init__.py", "", "import math\n", False),
        ("later.py", "1", "2", False),
        # Of a message only what it computes.
        ("helper.py", "doubles", "takes twice", True),
        ("helper.py", " again", " once more", True),
        ("helper.py", "negative. Give", "below 0; give", True),
        ("helper.py", '"not a number"', '"infinite", "or not a number"', True),
        ("helper.py", "{name + 1}", "{name + 2}", False),
        ("helper.py", "x > 2", "x > 3", False),
        ("helper.py", "ValueError", "TypeError", False),
        # Values of options are parameters of the rule.
        ("helper.py", "3000", "7000", True),
        ("helper.py", "Count = 3000", "Natural = 3000\n    seed: int = 0", True),
        ("helper.py", "2 *", "3 *", False),
        ("helper.py", "(Options)", "", False),
        # Templates beside a module that is reached, not those beside a package alone.
        ("pages/story.html.j2", "<p>", "<div>", False),
        ("templates/page.html.j2", "<p>", "<div>", True),
        ("kernels/source/part.h", "2.0f", "2.5f", False),
        ("kernels/source/part.h", "// Twice.", "/* Two times. */", True),
    ],
)
def test_the_hash_changes_with_code_that_a_stage_executes(stage_hash, file, old, new, same):
    assert old in FILES[file]
    first = stage_hash()
    assert (stage_hash(file, FILES[file].replace(old, new, 1)) == first) == same


def test_versions_of_libraries_change_the_hash_and_a_record_has_those_that_its_room_imports():
    assert code_hash("egosplat.geometry") != code_hash("egosplat.geometry", libraries=("numpy",))
    known = metadata.packages_distributions()
    counted = known.keys() - {"egosplat", "pydantic", "gsply"}  # who installs an extra need not train again
    for stage in map(STAGES.get, set(PIPELINE) - {"synthetic"}):
        room, reached = stage.module.rpartition(".")[0], modules_of(stage.module, *stage.modules.values())
        own = (parse_module(*each).imports for each in reached.items() if room in each[0])
        imported = {name.partition(".")[0] for names in own for name in names} & counted
        assert {known[name][0] for name in imported} <= {*stage.libraries}, room


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
    texts = [
        path for path in Path(fingerprint.__file__).parents[1].rglob("*") if path.suffix in fingerprint.TEXTS
    ]
    assert texts and {path.parent for path in texts} <= folders


SOURCE = """\
#include <cmath>
#define TWICE(x) ((x) + (x))
// Doubles.
float twice(float x) { return 2.0f * x; }
const char* text = "a // b";
"""


@pytest.mark.parametrize(
    "old, new, same",
    [
        ("// Doubles.", "// Makes it two\n// times as large.", True),
        ("{ return 2.0f * x; }", "{\n\n\treturn 2.0f*x;\n}", True),
        ("((x) + (x))", "\\\n    ((x) + (x))", True),
        ("2.0f", "2.5f", False),
        ('"a // b"', '"a // c"', False),
        ("x; }", "x; } // }\n}", False),
        ("TWICE(x) (", "TWICE (x) (", False),
        ("<cmath>\n", "<cmath> ", False),
        ("// Doubles.", "#define MORE", False),
    ],
)
def test_tokens_of_cpp_change_with_code_and_not_with_comments_and_layout(old, new, same):
    assert old in SOURCE
    assert (list(cpp_tokens(SOURCE.replace(old, new))) == list(cpp_tokens(SOURCE))) == same


def test_names_and_scripts_of_sources_count_and_other_files_do_not(tmp_path):
    (tmp_path / "kernels.cpp").write_text(SOURCE)
    first = cpp_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("why")
    assert scripts_hash(tmp_path) == ""
    (tmp_path / "page.js").write_text("one();")
    script = scripts_hash(tmp_path)
    (tmp_path / "page.js").write_text("two();")
    assert scripts_hash(tmp_path) not in ("", script) and cpp_hash(tmp_path) == first
    (tmp_path / "kernels.cpp").rename(tmp_path / "kernels.h")
    assert cpp_hash(tmp_path) != first
