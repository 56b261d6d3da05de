"""What a module imports, and a hash of its syntax tree; kept in a folder, because parsing the whole package takes seconds."""

import ast
import contextlib
import functools
import hashlib
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from egosplat.files import read_json, user_cache

# Syntax nodes that may have a docstring.
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef

# Functions whose arguments are words for a reader; as are those of an exception that is raised.
WORDED = {"UserError", "log", "track"}

# This file is a part of the keys of kept modules: an edited rule of hashing forgets what the earlier one gave.
_OWN = Path(__file__).read_bytes()


class ParsedModule(NamedTuple):
    """A module's part of a code hash: a hash of its syntax tree without comments, layout, docstrings, the words of messages
    and the keys of options, and the names of the modules that it imports, and of the objects that it imports from them."""

    tree_hash: str
    imports: tuple[str, ...]


@functools.cache
def parse_module(name: str, path: Path) -> ParsedModule:
    """Parse the module ``name``, or a definition in the module at ``path``; or read what was kept of the same content."""
    source = path.read_bytes()
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    last = name.rpartition(".")[2]
    definition = "" if path.stem in (last, "__init__") else last
    tables = {table.stem: table.read_text() for table in sorted((path.parent / "tables").glob("*.txt"))}
    key = hashlib.sha256(_OWN + f" {package} {definition} {tables}\n".encode() + source).hexdigest()
    # Without a folder to write in, each start parses again. ``Path.home`` raises RuntimeError for a user without one.
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        tree_hash, imports = read_json(user_cache() / "modules" / key)
        return ParsedModule(tree_hash, tuple(imports))
    tree = ast.parse(source)
    if definition:
        _leave_definition(tree, definition)
    imports = tuple(_imported(tree, package))
    _drop_messages(tree)
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    read = [
        tables[ast.literal_eval(call.args[0])] for call in calls if ast.unparse(call.func) == "read_table"
    ]
    module = ParsedModule(hashlib.sha256("".join([_canonical(tree), *read]).encode()).hexdigest(), imports)
    with contextlib.suppress(OSError, RuntimeError):
        kept = user_cache() / "modules" / key
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(module))
    return module


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


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    """All statements at any depth. Expressions hold no statements and are skipped."""
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, block, ()):
            yield node
            yield from _statements(node)


def _leave_definition(tree: ast.Module, name: str) -> None:
    """Leave of a module the definition of a name, with the imports and the definitions above it that it needs."""
    needed, kept = {name}, []
    for statement in reversed(tree.body):
        if isinstance(statement, ast.Import | ast.ImportFrom):
            statement.names = [alias for alias in statement.names if (alias.asname or alias.name) in needed]
            is_needed = bool(statement.names)
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef):
            is_needed = statement.name in needed
        else:
            targets = getattr(statement, "targets", [getattr(statement, "target", statement)])
            is_needed = any(not needed.isdisjoint(_names(target)) for target in targets)
        if is_needed:
            kept.append(statement)
            needed |= _names(statement)
    tree.body = kept[::-1]


def _names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _canonical(node: Any) -> str:
    """A tree's non-empty fields in order, without docstrings and keys. Unlike ``ast.dump``, equal on every Python version."""
    if not isinstance(node, ast.AST):
        return f"[{','.join(map(_canonical, node))}]" if isinstance(node, list) else repr(node)
    fields = dict(ast.iter_fields(node))
    if isinstance(node, DOCUMENTED):
        fields["body"] = [statement for statement in node.body if not _is_left_out(statement, node)]
    filled = {key: value for key, value in fields.items() if value is not None and value != []}
    return f"{type(node).__name__}({','.join(f'{key}={_canonical(value)}' for key, value in filled.items())})"


def _is_left_out(statement: ast.stmt, owner: ast.AST) -> bool:
    """Whether a statement is a docstring, a configuration key, whose value is a parameter of the rule, or a class of keys alone."""
    match statement:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
        case ast.AnnAssign():
            return _is_options(owner)
        case ast.ClassDef(body=body):  # other stages of the room do not see a new one
            return _is_options(statement) and all(_is_left_out(inner, statement) for inner in body)
    return False


def _is_options(node: ast.AST) -> bool:
    # A class with a decorator is a dataclass, whose fields are set by code.
    if not isinstance(node, ast.ClassDef) or node.decorator_list:
        return False
    return any(isinstance(base, ast.Name) and base.id.endswith("Options") for base in node.bases)


def _drop_messages(tree: ast.AST) -> None:
    """Replace the texts of messages by the expressions whose values they show."""
    for node in ast.walk(tree):
        call = node.exc if isinstance(node, ast.Raise) else node
        if not isinstance(call, ast.Call):
            continue
        if call is not node or (isinstance(call.func, ast.Name) and call.func.id in WORDED):
            texts = [word.value for word in call.keywords if _computed(word.value) != [word.value]]
            call.keywords = [word for word in call.keywords if word.value not in texts]
            call.args = [part for text in [*call.args, *texts] for part in _computed(text)]


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
