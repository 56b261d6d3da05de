"""Content hash of the code that a stage executes.

Snakemake cannot see code changes behind a command line, so each rule has this hash among its parameters. ``code_hash``
follows the imports from a stage's modules inside our packages and hashes each module's syntax tree, the tokens of C++
sources, and the scripts of pages.
"""

import functools
import hashlib
import importlib.util
import re
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from egosplat.pipeline.parsed_modules import parse_module

# The packages whose modules count.
ROOTS = {"egosplat", "egosplat_apartments", "egosplat_rivals"}

# Text that code beside it reads: templates of pages and tables; and scripts of pages, beside C++ sources.
TEXTS = (".csv", ".j2", ".yml")
SCRIPTS = (".css", ".glsl", ".html", ".js")

# Modules that show, record or write, but cannot change an array: a better message makes nothing stale.
_NEUTRAL = """artifacts.provenance errors files progress pipeline pipeline.code_hash pipeline.home pipeline.messages
pipeline.options pipeline.parsed_modules pipeline.process_guards pipeline.shared_options pipeline.stage pipeline.stages
pipeline.strict_yaml pipeline.validation"""
NEUTRAL = {"egosplat", *(f"egosplat.{name}" for name in _NEUTRAL.split())}

# Of these modules a stage executes the definitions that it imports by name, each with those that it needs.
SPLIT = {"egosplat.artifacts.schemas"}


def code_hash(*modules: str, libraries: tuple[str, ...] = ()) -> str:
    """Hash modules, the modules, C++ sources, scripts and texts that they reach, and versions of libraries.

    Returns:
        16 hexadecimal digits, equal on every Python version.
    """
    digest = hashlib.sha256()
    folders = {}
    for name, path in modules_of(*modules).items():
        digest.update(f"{name}\0{parse_module(name, path).tree_hash}\0".encode())
        # Compiled kernels, and scripts and templates of pages, are executed code, too.
        if path.name != "__init__.py":
            folders[path.parent] = None
        elif (sources := path.parent / "source").is_dir():
            digest.update(f"{name}/source\0{_cached_cpp(sources)}{_cached_scripts(sources)}\0".encode())
    for folder in folders:
        digest.update(_cached_scripts(folder, TEXTS).encode())
    # A library may change a result without any change of our code.
    for library in sorted(libraries):
        digest.update(f"{library}=={library_version(library)}\0".encode())
    return digest.hexdigest()[:16]


@functools.cache
def library_version(name: str) -> str:
    """The version of a library; ``absent`` for one that is not installed, which the stage reports if it needs it."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "absent"


def modules_of(*modules: str) -> dict[str, Path]:
    """Name and path of every module of our packages that ``modules`` reach by imports, sorted by name."""
    roots = ROOTS | {module.partition(".")[0] for module in modules}
    found: dict[str, Path] = {}
    todo = [*modules]
    while todo:
        name = todo.pop()
        if name in found or name in NEUTRAL | SPLIT or name.partition(".")[0] not in roots:
            continue
        if (path := _find(name)) is None:
            continue
        found[name] = path
        todo.extend(parse_module(name, path).imports)
        # Importing a module runs its parent packages.
        todo.extend(name.rsplit(".", level)[0] for level in range(1, name.count(".") + 1))
    return dict(sorted(found.items()))


@functools.cache
def _find(name: str) -> Path | None:
    """Find the file of a module of our packages, or of a definition in a split one; None for another name."""
    if (module := name.rpartition(".")[0]) in SPLIT:
        return _find(module)
    # No find_spec for the full name: it would import the parent modules and all that the stage needs.
    root, *parts = name.split(".")
    spec = importlib.util.find_spec(root)
    if spec is None or spec.origin is None:
        return None
    base = Path(spec.origin).parent.joinpath(*parts)
    candidates = (base / "__init__.py", base.with_suffix(".py"))
    return next((path for path in candidates if path.is_file()), None)


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
    for path in sorted(path for path in folder.iterdir() if path.suffix in (".cpp", ".h")):
        digest.update(f"{path.name}\0".encode())
        for token in cpp_tokens(path.read_text(encoding="utf-8")):
            digest.update(f"{token}\0".encode())
    return digest.hexdigest()[:16]


def scripts_hash(folder: Path, suffixes: tuple[str, ...] = SCRIPTS) -> str:
    """Hash the names and bytes of files in ``folder``, the scripts of a page. Returns 16 hexadecimal digits; "" without any."""
    paths = sorted(path for path in folder.iterdir() if path.suffix in suffixes)
    content = b"".join(path.name.encode() + b"\0" + path.read_bytes() + b"\0" for path in paths)
    return hashlib.sha256(content).hexdigest()[:16] if paths else ""


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


_cached_cpp, _cached_scripts = functools.cache(cpp_hash), functools.cache(scripts_hash)
