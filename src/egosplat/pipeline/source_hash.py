"""Content hash of C++ sources as the compiler sees them, without comments and layout, and of the scripts of pages."""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

SUFFIXES = (".cpp", ".h")
SCRIPTS = (".css", ".glsl", ".html", ".js")

_SPLICE = re.compile(r"\\[ \t]*\r?\n")
_TOKEN = re.compile(
    r"""
    (?P<skip>     //[^\n]* | /\*.*?\*/ | [^\S\n]+ )
  | (?P<newline>  \n )
  | (?P<raw>      (?:u8|[uUL])?R"(?P<mark>[^()\\\s]{0,16})\(.*?\)(?P=mark)" )
  | (?P<text>     "(?:\\.|[^"\\\n])*" | '(?:\\.|[^'\\\n])*' )
  | (?P<number>   \.?\d(?:[eEpP][+-]|'?[\w.])* )
  | (?P<word>     \w+ )
  | (?P<operator> <<=|>>=|<=>|\.\.\.|->\*|::|->|\.\*|\+\+|--|<<|>>|&&|\|\||\#\#|[-+*/%&|^<>=!]= )
  | (?P<other>    . )
    """,
    re.VERBOSE | re.DOTALL,
)


def cpp_hash(folder: Path) -> str:
    """Hash the names and tokens of the C++ files in ``folder``. Returns 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.iterdir() if path.suffix in SUFFIXES):
        digest.update(f"{path.name}\0".encode())
        for token in cpp_tokens(path.read_text(encoding="utf-8")):
            digest.update(f"{token}\0".encode())
    return digest.hexdigest()[:16]


def scripts_hash(folder: Path, suffixes: tuple[str, ...] = SCRIPTS) -> str:
    """Hash the names and bytes of files in ``folder``, the scripts of a page. Returns 16 hexadecimal digits; "" without any."""
    paths = sorted(path for path in folder.iterdir() if path.suffix in suffixes)
    told = b"".join(path.name.encode() + b"\0" + path.read_bytes() + b"\0" for path in paths)
    return hashlib.sha256(told).hexdigest()[:16] if paths else ""


def cpp_tokens(text: str) -> Iterator[str]:
    """Split a C++ source into tokens, without comments and white space."""
    # White space matters only in a preprocessor directive: at its end, and before a parenthesis, where it separates the
    # name of a macro without arguments from its text.
    in_directive, line_begins, end = False, True, 0
    for match in _TOKEN.finditer(_SPLICE.sub("", text)):
        kind, token = match.lastgroup, match.group()
        if kind == "skip":
            continue
        if kind == "newline":
            if in_directive:
                yield token
            in_directive, line_begins = False, True
            continue
        in_directive = in_directive or (line_begins and token == "#")
        line_begins = False
        if in_directive and token == "(" and match.start() > end:
            yield " "
        end = match.end()
        yield token
