"""Checks that artifacts belong together: each was made from the ones that it is used with."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from egosplat.artifacts.integrity import rebuild_command
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError


def check_made_from(made: Artifact, *sources: Artifact, axes: Sequence[str] = ()) -> None:
    """Check that an artifact was made from ``sources``.

    Args:
        made: the artifact. Sources whose file name its provenance does not record are compared by ``axes`` alone.
        sources: what it is used with.
        axes: names of axes, as the schemas declare them, that have one size in ``made`` and in every source.

    Raises:
        UserError: a digest or a size differs.
    """
    inputs = made.provenance["inputs"]
    for source in sources:
        same = inputs.get(source.path.name, source.digest) == source.digest
        if not same or any(_size(made, axis) != _size(source, axis) for axis in axes):
            raise made_from_another(made.path, source.path)


def check_inputs(path: Path, inputs: Mapping[str, str], sources: Sequence[Artifact]) -> None:
    """Raise UserError unless a JSON result at ``path``, by the digests of its inputs, was made from ``sources``."""
    for source in sources:
        if source.digest not in inputs.values():
            raise made_from_another(path, source.path)


def made_from_another(path: Path, source: Path) -> UserError:
    """The error for a result that was made from another artifact than ``source``."""
    return UserError(
        f"{path}: was made from another {source.name} than {source}. Rebuild it: {rebuild_command(path)}"
    )


def _size(artifact: Artifact, axis: str) -> int:
    fields = artifact.schema.fields.items()
    name, position = next((name, field.dims.index(axis)) for name, field in fields if axis in field.dims)
    return artifact.shape(name)[position]
