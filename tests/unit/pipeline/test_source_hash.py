"""The hash of C++ sources changes with their tokens only."""

import pytest

from egosplat.pipeline.code_hash import cpp_hash, cpp_tokens, scripts_hash

SOURCE = """\
#include <cmath>
#define TWICE(x) ((x) + (x))
// Doubles.
float twice(float x) { return 2.0f * x; }
const char* text = "a // b";
"""


@pytest.mark.parametrize(
    "old, new",
    [
        ("// Doubles.", "// Makes it two\n// times as large."),
        ("2.0f * x", "2.0f /* not\n 3 */ * x"),
        ("{ return 2.0f * x; }", "{\n\n\treturn 2.0f*x;\n}"),
        ("#include <cmath>", "#  include <cmath>   // sqrt"),
        ("((x) + (x))", "\\\n    ((x) + (x))"),
        ("float twice", "\n\nfloat\ntwice"),
    ],
)
def test_comments_and_layout_do_not_change_the_hash(old, new):
    assert old in SOURCE
    assert list(cpp_tokens(SOURCE.replace(old, new))) == list(cpp_tokens(SOURCE))


@pytest.mark.parametrize(
    "old, new",
    [
        ("2.0f", "2.5f"),
        ('"a // b"', '"a // c"'),
        ("x; }", "x; } // }\n}"),
        ("(x) + (x))\n", "(x) + (x)) +\n"),
        ("TWICE(x) (", "TWICE (x) ("),
        ("<cmath>\n", "<cmath> "),
        ("// Doubles.", "#define MORE"),
    ],
)
def test_code_changes_change_the_hash(old, new):
    assert old in SOURCE
    assert list(cpp_tokens(SOURCE.replace(old, new))) != list(cpp_tokens(SOURCE))


@pytest.mark.parametrize(
    "text, tokens",
    [
        ("a++ + b", ["a", "++", "+", "b"]),
        ("x>>=1'000;", ["x", ">>=", "1'000", ";"]),
        ("1e-3f-x", ["1e-3f", "-", "x"]),
        (r"'\'' '/' \"//\"".replace('\\"', '"'), [r"'\''", "'/'", '"//"']),
        ('R"d(a "// b)d" // c', ['R"d(a "// b)d"']),
        ("#if A\nb", ["#", "if", "A", "\n", "b"]),
        ("a // joined \\\nstill a comment\nb", ["a", "b"]),
    ],
)
def test_sources_are_split_into_the_tokens_of_cpp(text, tokens):
    assert list(cpp_tokens(text)) == tokens


def test_file_names_count_and_other_files_do_not(tmp_path):
    (tmp_path / "kernels.cpp").write_text(SOURCE)
    first = cpp_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("why")
    assert cpp_hash(tmp_path) == first
    (tmp_path / "kernels.cpp").rename(tmp_path / "kernels.h")
    assert cpp_hash(tmp_path) != first


def test_the_scripts_of_a_page_count(tmp_path):
    """An edit of a script makes the page stale; a folder of C++ has the hash that it had without scripts."""
    (tmp_path / "kernel.cpp").write_text("int one;")
    before = cpp_hash(tmp_path)
    assert scripts_hash(tmp_path) == ""
    (tmp_path / "page.js").write_text("one();")
    first = scripts_hash(tmp_path)
    (tmp_path / "page.js").write_text("two();")
    assert scripts_hash(tmp_path) not in ("", first)
    assert cpp_hash(tmp_path) == before
