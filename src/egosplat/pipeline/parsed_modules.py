"""What a module imports, and a hash of its syntax tree; kept in a file, because parsing the whole package takes seconds."""

import ast
import contextlib
import functools
import hashlib
import importlib.util
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.files import atomic_file, read_json, user_cache

# Syntax nodes that may have a docstring.
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

# Functions whose arguments are words for a reader; as are those of an exception that is raised.
WORDED = {"UserError", "log", "track", "AlarmRow"}

# Modules in the file: a few versions of the whole package.
MOST_MODULES = 4000


@dataclass(frozen=True)
class ParsedModule:
    """A module's part of a code hash: a hash of its syntax tree without comments, layout, docstrings, the words of messages
    and the keys of options, and the names of the modules that it imports, and of the objects that it imports from them.
    """

    tree_hash: str
    imports: tuple[str, ...]


@functools.cache
def parse_module(name: str, path: Path) -> ParsedModule:
    """Parse the module ``name``, or a definition in the module at ``path``; or read what was kept of the same content."""
    source = path.read_bytes()
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    # This file is a part of the key: an edited rule of hashing forgets what the earlier one gave.
    definition = name.rpartition(".")[2] if path.stem not in (name.rpartition(".")[2], "__init__") else ""
    key = hashlib.sha256(f"{_own_hash()} {package} {definition}\n".encode() + source).hexdigest()
    found = _kept().pop(key, None)
    if found is None:
        tree = ast.parse(source)
        if definition:
            _leave_definition(tree, definition)
        imports = [*_imported(tree, package)]
        found = [_hash(_canonical(_WordsDropped().visit(tree))), imports]
        _new.append(key)
    # The latest come last.
    _kept()[key] = found
    tree_hash, imports = found
    return ParsedModule(tree_hash, tuple(imports))


def keep_parsed() -> None:
    """Write modules that were parsed since the last call to the file."""
    if not _new:
        return
    _new.clear()
    latest = [*_kept().items()][-MOST_MODULES:]
    # Without a folder to write in, each start parses again. ``Path.home`` raises RuntimeError for a user without one.
    with contextlib.suppress(OSError, RuntimeError), atomic_file(_file()) as scratch:
        scratch.write_text(json.dumps(dict(latest)), encoding="utf-8")


_new: list[str] = []
"""Keys of the modules that the file lacks."""


def _file() -> Path:
    return user_cache() / "parsed_modules.json"


@functools.cache
def _kept() -> dict[str, list[Any]]:
    """Hash and imports of each module by its key."""
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        found = read_json(_file())
        if isinstance(found, dict) and all(map(_is_sound, found.values())):
            return found
    return {}


def _is_sound(found: Any) -> bool:
    match found:
        case [str(), [*names]]:
            return all(isinstance(name, str) for name in names)
    return False


@functools.cache
def _own_hash() -> str:
    return _hash(Path(__file__).read_text(encoding="utf-8"))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _imported(tree: ast.Module, package: str) -> Iterator[str]:
    # Imports inside functions count, because the stage executes them.
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = importlib.util.resolve_name("." * node.level + base, package)
            yield base
            # ``from package import name``: the name may be a module or an object of the package.
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _leave_definition(tree: ast.Module, name: str) -> None:
    """Leave of a module the definition of a name, with the imports and the definitions above it that it needs."""
    needed, kept = {name}, []
    for statement in reversed(tree.body):
        if isinstance(statement, ast.Import | ast.ImportFrom):
            statement.names = [alias for alias in statement.names if (alias.asname or alias.name) in needed]
            is_needed = bool(statement.names)
        else:
            is_needed = not needed.isdisjoint(_bound(statement))
        if is_needed:
            kept.append(statement)
            needed |= {node.id for node in ast.walk(statement) if isinstance(node, ast.Name)}
    tree.body = kept[::-1]


def _bound(statement: ast.stmt) -> set[str]:
    """The names that a definition gives to the module."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return {statement.name}
    targets = getattr(statement, "targets", [getattr(statement, "target", statement)])
    return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    """All statements at any depth. Expressions hold no statements and are skipped."""
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, block, ()):
            yield node
            yield from _statements(node)


def _canonical(node: Any) -> str:
    """A tree's non-empty fields in order, without docstrings and keys. Unlike ``ast.dump``, equal on every Python version."""
    if not isinstance(node, ast.AST):
        return f"[{','.join(map(_canonical, node))}]" if isinstance(node, list) else repr(node)
    fields = dict(ast.iter_fields(node))
    if isinstance(node, DOCUMENTED):
        left_out = (_is_bare_text(one) or _is_key(one, node) or _holds_keys(one) for one in node.body)
        fields["body"] = [one for one, out in zip(node.body, left_out, strict=True) if not out]
    told = (
        f"{key}={_canonical(value)}" for key, value in fields.items() if value is not None and value != []
    )
    return f"{type(node).__name__}({','.join(told)})"


class _WordsDropped(ast.NodeTransformer):
    """Replaces the texts of messages by the expressions whose values they show."""

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        if isinstance(node.exc, ast.Call):
            _drop_words(node.exc)
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if isinstance(node.func, ast.Name) and node.func.id in WORDED:
            _drop_words(node)
        return self.generic_visit(node)


def _drop_words(call: ast.Call) -> None:
    call.args = [part for argument in call.args for part in _computed(argument)]
    kept = [word for word in call.keywords if _computed(word.value) == [word.value]]
    call.args += [part for word in call.keywords if word not in kept for part in _computed(word.value)]
    call.keywords = kept


def _computed(text: ast.expr) -> list[ast.expr]:
    """The expressions of a text, without its words; an expression of another kind as it is."""
    match text:
        case ast.Constant(value=str()):
            return []
        case ast.JoinedStr(values=values):
            return [part for value in values for part in _computed(value)]
        case ast.FormattedValue(value=value):
            return _computed(value)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return [*_computed(left), *_computed(right)]
        case ast.IfExp(test=test, body=body, orelse=orelse):
            return [test, *_computed(body), *_computed(orelse)]
    return [text]


def _is_key(item: ast.stmt, node: ast.AST) -> bool:
    """Whether a statement defines a configuration key, whose value is a parameter of the rule."""
    # A class with a decorator is a dataclass, whose fields are set by code.
    if not (isinstance(item, ast.AnnAssign) and isinstance(node, ast.ClassDef) and not node.decorator_list):
        return False
    names = (base.id for base in node.bases if isinstance(base, ast.Name))
    return any(name.endswith("Options") for name in names)


def _holds_keys(item: ast.stmt) -> bool:
    """Whether a statement is a class of options with keys alone: other stages of the room do not see a new one."""
    return (
        isinstance(item, ast.ClassDef)
        and any(isinstance(base, ast.Name) and base.id.endswith("Options") for base in item.bases)
        and all(_is_bare_text(one) or _is_key(one, item) for one in item.body)
    )


def _is_bare_text(node: ast.AST) -> bool:
    """Whether a statement is only a string: the docstring of a module, class, function or attribute."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
