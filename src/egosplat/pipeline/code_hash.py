"""Content hash of the code that a stage executes.

Snakemake cannot see code changes behind a command line, so each rule has this hash among its parameters. ``code_hash``
follows the imports from a stage's module inside the package and hashes each module's syntax tree.
"""

import ast
import functools
import hashlib
import importlib.util
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from egosplat.pipeline.source_hash import cpp_hash, scripts_hash

# Modules that show or record, but cannot change an array: a better message makes nothing stale.
NEUTRAL = {
    "egosplat",  # holds only the version
    "egosplat.files",
    "egosplat.artifacts.usage",
    "egosplat.pipeline.source_hash",
    "egosplat.errors",
    "egosplat.pipeline",
    "egosplat.pipeline.code_hash",
    "egosplat.pipeline.process_guards",
    "egosplat.pipeline.validation",
    "egosplat.progress",
    "egosplat.artifacts.consistency",
    "egosplat.artifacts.provenance",
    "egosplat.pipeline.stages",
}

# Syntax nodes that may have a docstring.
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def code_hash(module: str, libraries: tuple[str, ...] = ()) -> str:
    """Hash ``module``, the modules, C++ sources and scripts that it reaches in its package, and versions of libraries.

    Returns:
        16 hexadecimal digits, equal on every Python version.
    """
    digest = hashlib.sha256()
    for name, path in modules_of(module).items():
        # The tree has neither comments nor layout; ``_canonical`` leaves out docstrings.
        digest.update(f"{name}\0{_tree_hash(path)}\0".encode())
        # Compiled kernels and the scripts of pages are executed code, too.
        if path.name == "__init__.py" and (sources := path.parent / "source").is_dir():
            digest.update(f"{name}/source\0{_sources_hash(sources)}\0".encode())
    # A library may change a result without any change of our code.
    for library in sorted(libraries):
        digest.update(f"{library}=={metadata.version(library)}\0".encode())
    return digest.hexdigest()[:16]


def modules_of(module: str) -> dict[str, Path]:
    """Name and path of every module of the package that ``module`` reaches by imports, sorted by name."""
    root = module.partition(".")[0]
    found: dict[str, Path] = {}
    todo = [module]
    while todo:
        name = todo.pop()
        if name in found or name in NEUTRAL or name.partition(".")[0] != root:
            continue
        if (path := _find(name)) is None:
            continue
        found[name] = path
        todo.extend(_imports(name, path))
        # Importing a module runs its parent packages.
        todo.extend(name.rsplit(".", level)[0] for level in range(1, name.count(".") + 1))
    return dict(sorted(found.items()))


@functools.cache
def _find(name: str) -> Path | None:
    """Find the file of a module below the root package; None if the name is not a module."""
    # No find_spec for the full name: it would import the parent modules and all that the stage needs.
    root, *parts = name.split(".")
    if (folder := _folder(root)) is None:
        return None
    base = folder.joinpath(*parts)
    candidates = (base / "__init__.py", base.with_suffix(".py"))
    return next((path for path in candidates if path.is_file()), None)


@functools.cache
def _folder(root: str) -> Path | None:
    spec = importlib.util.find_spec(root)
    return None if spec is None or spec.origin is None else Path(spec.origin).parent


@functools.cache
def _imports(name: str, path: Path) -> tuple[str, ...]:
    """Names of the modules that a module imports, and of the objects that it imports from them."""
    return tuple(_imported(name, path))


def _imported(name: str, path: Path) -> Iterator[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    # Imports inside functions count, because the stage executes them.
    for node in _statements(_parse(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = importlib.util.resolve_name("." * node.level + base, package)
            yield base
            # ``from package import name``: the name may be a module or an object of the package.
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    """All statements at any depth. Expressions hold no statements and are skipped."""
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, block, ()):
            yield node
            yield from _statements(node)


@functools.cache
def _parse(path: Path) -> ast.Module:
    return ast.parse(path.read_bytes())


@functools.cache
def _tree_hash(path: Path) -> str:
    return hashlib.sha256("\0".join(_canonical(_parse(path))).encode()).hexdigest()


@functools.cache
def _sources_hash(folder: Path) -> str:
    return cpp_hash(folder) + scripts_hash(folder)


def _canonical(node: Any) -> list[str]:
    """A tree's non-empty fields in order, without docstrings. Unlike ``ast.dump``, equal on every Python version."""
    parts: list[str] = []
    _append(node, parts)
    return parts


def _append(node: Any, parts: list[str]) -> None:
    if isinstance(node, ast.AST):
        parts.append(f"{type(node).__name__}(")
        for key, value in ast.iter_fields(node):
            if key == "body" and isinstance(node, DOCUMENTED):
                value = [item for item in value if not _is_bare_text(item)]
            if value is not None and value != []:
                parts.append(key)
                _append(value, parts)
        parts.append(")")
    elif isinstance(node, list):
        parts.append("[")
        for item in node:
            _append(item, parts)
        parts.append("]")
    else:
        parts.append(repr(node))


def _is_bare_text(node: ast.AST) -> bool:
    """Whether a statement is only a string: the docstring of a module, class, function or attribute."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
