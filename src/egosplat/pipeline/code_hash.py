"""Content hash of the code that a stage executes.

Snakemake cannot see code changes behind a command line, so each rule has this hash among its parameters. ``code_hash``
follows the imports from a stage's modules inside our packages and hashes each module's syntax tree.
"""

import functools
import hashlib
import importlib.util
from importlib import metadata
from pathlib import Path

from egosplat.pipeline.parsed_modules import keep_parsed, parse_module
from egosplat.pipeline.source_hash import cpp_hash, scripts_hash

# The packages whose modules count.
ROOTS = {"egosplat", "egosplat_apartments", "egosplat_rivals"}

# Text that code beside it reads: templates of pages, and tables.
TEXTS = (".csv", ".j2")

# Modules that show, record or write, but cannot change an array: a better message makes nothing stale.
NEUTRAL = {
    "egosplat",  # holds only the version and public names
    *(
        f"egosplat.{name}"
        for names in (
            "alarms.texts artifacts.provenance errors files progress pipeline",
            "pipeline.code_hash pipeline.home pipeline.messages pipeline.options pipeline.parsed_modules",
            "pipeline.process_guards pipeline.shared_options pipeline.source_hash pipeline.stage pipeline.stages",
            "pipeline.strict_yaml pipeline.validation",
        )
        for name in names.split()
    ),
}

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
            digest.update(f"{name}/source\0{_sources_hash(sources)}\0".encode())
    for folder in folders:
        digest.update(_texts_hash(folder).encode())
    # A library may change a result without any change of our code.
    for library in sorted(libraries):
        digest.update(f"{library}=={library_version(library)}\0".encode())
    keep_parsed()
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
    """Find the file of a module below the root package, or of a definition in a split one; None for another name."""
    if (module := name.rpartition(".")[0]) in SPLIT:
        return _find(module)
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
def _sources_hash(folder: Path) -> str:
    return cpp_hash(folder) + scripts_hash(folder)


@functools.cache
def _texts_hash(folder: Path) -> str:
    return scripts_hash(folder, TEXTS)
