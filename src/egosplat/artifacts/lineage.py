"""Find all artifacts that an artifact was made from, and those of a scene or variant from its folder; verify a whole folder."""

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path

from egosplat.artifacts.consistency import check_made_from, made_from_another
from egosplat.artifacts.integrity import rebuild_command
from egosplat.artifacts.reader import Artifact, open_any, open_artifact, recorded_digest, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError, user_message
from egosplat.pipeline.home import shared_with
from egosplat.pipeline.validation import read_document

# The schema of each JSON file of results.
DOCUMENTS = {"metrics.json": "metrics", "survey.json": "survey"}


@dataclass(frozen=True)
class Lineage:
    """Artifacts with everything that they were made from, by sorted file name; and those of inputs that are absent, or that
    only differ in digest from one that is there."""

    found: Mapping[str, Artifact]
    lost: tuple[str, ...]


def open_inputs(paths: Mapping[str, Path | None]) -> dict[str, Artifact]:
    """Open the artifacts that a stage is given, by name, the latest last; a path is called as ``frames_path``, None if not given."""
    given = {name: path for name in SCHEMAS if (path := paths.get(f"{name}_path")) is not None}
    return {name: open_artifact(path, SCHEMAS[name]) for name, path in given.items()}


def lineage(artifacts: Sequence[Artifact]) -> Lineage:
    """Find the inputs of artifacts by digest, where variants share them; UserError if two differ or one is damaged."""
    own = [artifact.path.parent for artifact in artifacts]
    folders = dict.fromkeys([*own, *(shared for folder in own for shared in shared_with(folder))])
    found = {artifact.path.name: artifact for artifact in artifacts}
    lost: set[str] = set()
    todo = list(artifacts)
    while todo:
        artifact = todo.pop()
        for name, digest in artifact.provenance["inputs"].items():
            if name in found:
                check_made_from(artifact, found[name])
            elif (path := _with_digest(folders, name, digest)) is None:
                lost.add(name)
            else:
                found[name] = open_any(path, SCHEMAS)
                todo.append(found[name])
    return Lineage(dict(sorted(found.items())), tuple(sorted(lost)))


def _with_digest(folders: Iterable[Path], name: str, digest: str) -> Path | None:
    """The first artifact of a name and a digest in folders."""
    paths = (folder / name for folder in folders)
    return next((path for path in paths if path.exists() and recorded_digest(path) == digest), None)


def locate(folder: Path, *names: str) -> list[Path]:
    """The path of each artifact of a scene or variant, which shares artifacts with its scene and other
    variants. One that is nowhere would be in ``folder``. UserError if an artifact or metrics.json of the
    variant is damaged, or its artifacts do not belong together."""
    found: Mapping[str, Artifact] = {}
    if shared_with(folder) and (own := _own(folder)):
        found = lineage(own).found
    paths = {file: artifact.path for file, artifact in found.items()}
    return [paths.get(f"{name}.zarr", folder / f"{name}.zarr") for name in names]


def _own(folder: Path) -> list[Artifact]:
    """The artifacts in a variant's folder, and the codes of which it has only scores."""
    own = [open_any(path, SCHEMAS) for path in sorted(folder.glob("*.zarr"))]
    scores = folder / "metrics.json"
    if all(artifact.schema.name != "language" for artifact in own) and scores.exists():
        digest = read_document(scores, "metrics")["provenance"]["inputs"]["language.zarr"]
        codes = _with_digest(shared_with(folder), "language.zarr", digest)
        own += [] if codes is None else [open_any(codes, SCHEMAS)]
    return own


def open_histories(folder: Path, splats: Artifact) -> Artifact | None:
    """Open histories.zarr of a scene or variant; None if none was made from these Gaussians; UserError if it is damaged."""
    paths = (place / "histories.zarr" for place in (folder, *shared_with(folder)))
    made = (open_any(path, SCHEMAS) for path in paths if path.exists())
    return next((one for one in made if one.provenance["inputs"][splats.path.name] == splats.digest), None)


def check_tree(folder: Path, say: Callable[[str], object]) -> dict[Path, str]:
    """Verify ``*.zarr`` and ``DOCUMENTS`` at or below a folder: the problem of each, empty if it is sound
    (UserError: there is none). Bytes match the digest, a JSON file its schema, and an input in the same
    folder the digest of the provenance."""
    # Unlike ``Path.rglob``, it follows links: a scene may lie on another disk.
    every = folder, *sorted(map(folder.joinpath, glob("**", root_dir=folder, recursive=True)))
    paths = [path for path in every if path.suffix == ".zarr" or path.name in DOCUMENTS]
    if not paths:
        raise UserError(f"{folder}: holds no artifact. Give a folder of results, such as results/adt/scene1")
    problems = {}
    for path in paths:
        problems[path] = problem = _problem(path)
        say(f"{'NOT OK ' if problem else 'ok     '} {problem or path}")
    return problems


def _problem(path: Path) -> str:
    try:
        if path.suffix == ".zarr":
            inputs = verify(path, SCHEMAS).provenance["inputs"]
        elif path.is_file():
            inputs = read_document(path, DOCUMENTS[path.name])["provenance"]["inputs"]
        else:
            return f"{path}: is no regular file. Rebuild it: {rebuild_command(path)}"
    except (UserError, OSError) as error:
        return user_message(error) or f"{path}: {error}"
    for name, digest in inputs.items():
        # A damaged input has its own line in the report.
        with contextlib.suppress(UserError, OSError):
            if recorded_digest(path.parent / name) != digest:
                return str(made_from_another(path, path.parent / name))
    return ""
