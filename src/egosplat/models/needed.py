"""The checkpoints that a configuration needs: where they lie, their license, size and digest, and how to fetch them."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.files import expand_home
from egosplat.models.checkpoints import CLIP, SAM2, content_hash
from egosplat.models.configs import PHOTO_WEIGHTS, PHOTOS, SENTENCES, SMALL, WeightsPackage
from egosplat.models.download import OfflineError, fetch, stored_digest, write_digest
from egosplat.models.suitability import configured_checkpoints
from egosplat.pipeline.model_sets import locate_checkpoints
from egosplat.pipeline.published import CATALOGUE, PublishedModel, model_of_file, named_model
from egosplat.progress import log

SMALL_FILES = {model.checkpoint_key: model.small for model in (SAM2, CLIP)}

# License of the bundled checkpoints, which is egosplat's own.
OWN_LICENSE = "Apache-2.0"


@dataclass(frozen=True)
class Needed:
    """A file with weights.

    Attributes:
        key: the configuration key that names it; empty for one that only the catalogue has.
        published: its entry of the catalogue; None for other files.
        package: the Python package that carries it; None for other files.
    """

    key: str
    path: Path
    published: PublishedModel | None
    package: WeightsPackage | None = None

    @property
    def missing(self) -> bool:
        return not self.path.is_file()

    @property
    def name(self) -> str:
        """The model in a few words."""
        if self.published:
            return f"{self.published.library} {self.published.architecture}, {self.published.weights}"
        if self.package:
            return f"{self.package.title}, of the Python package {self.package.name}"
        return "bundled with egosplat" if self.path in SMALL_FILES.values() else "your own file"


def find_needed(configs: Iterable[Mapping[str, Any]]) -> list[Needed]:
    """List the checkpoints that configurations need, each once; UserError if a package or a published one is missing."""
    found: dict[Path, Needed] = {}
    for config in map(locate_checkpoints, configs):
        named = {f"models.{key}": value for key, value in configured_checkpoints(config).items()}
        named["transient.encoder_weights"] = config["transient"]["encoder_weights"]
        for key, value in named.items():
            if value == PHOTOS:
                for package in (PHOTO_WEIGHTS, SENTENCES):
                    path = package.find()
                    found.setdefault(path, Needed(key, path, None, package))
            elif value is not None:
                path = SMALL_FILES[key.partition(".")[2]] if value == SMALL else expand_home(value)
                found.setdefault(path, Needed(key, path, model_of_file(path)))
    return list(found.values())


def catalogue(config: Mapping[str, Any], names: Sequence[str] = ()) -> list[Needed]:
    """List checkpoints of the catalogue, by architecture or file, in ``models.cache``; UserError for an unknown name."""
    cache = expand_home(config["models"]["cache"])
    models = [named_model(name) for name in names] or CATALOGUE
    return [Needed("", cache / one.file, one) for one in models]


def listing(files: Sequence[Needed], options: Sequence[str] = ()) -> str:
    """Describe files, hashed if they are there; the command that fetches the others repeats the ``options``."""
    parts = [_entry(one) for one in files]
    missing = [one for one in files if one.missing]
    fetchable = [one for one in missing if one.published]
    if fetchable:
        total = sum(one.published.megabytes for one in fetchable if one.published)
        names = [] if files[0].key else [one.published.architecture for one in fetchable if one.published]
        command = shlex.join(["egosplat", "models", "download", *names, *options])
        parts.append(f"{len(fetchable)} of {len(files)} files are to be fetched, {total:,.0f} MB: {command}")
    elif not missing:
        parts.append("Nothing is missing.")
    return "\n\n".join(parts)


def download(files: Sequence[Needed]) -> list[str]:
    """Fetch what is missing of published checkpoints, and verify what is there; a line for each file.

    Raises:
        UserError: a file cannot be fetched, or is not the published one; without a connection, with addresses and places.
    """
    lines = []
    for one in files:
        if one.published is None:
            if one.missing:
                raise UserError(
                    f"{one.key}: there is no file {one.path}, and egosplat's catalogue does not have it"
                )
            lines.append(f"{one.path}: {one.name}")
        elif one.missing:
            lines.append(_fetched(one, one.published, files))
        else:
            lines.append(_verified(one, one.published))
    return lines


def _fetched(one: Needed, model: PublishedModel, files: Sequence[Needed]) -> str:
    log(f"{one.path.name}: {model.megabytes:,.0f} MB from {model.address} (license: {model.license})")
    try:
        digest = fetch(model, one.path)
    except OfflineError as error:
        by_hand = [
            f"{each.published.address} -> {each.path}" for each in files if each.published and each.missing
        ]
        raise UserError(f"{error}.\nFetch by hand: {'; '.join(by_hand)}") from None
    return f"{one.path}: fetched, {_trust(model, digest)}"


def _verified(one: Needed, model: PublishedModel) -> str:
    """A line about a file that is there. Its digest is stored if nothing else could verify it later."""
    digest, known = content_hash(one.path), model.sha256 or stored_digest(one.path)
    if known not in (None, digest):
        source = "published" if model.sha256 else "that of the first copy"
        raise UserError(
            f"{one.path}: has SHA-256 {digest}, {source} is {known}: it is damaged, or another file.\n"
            "Remove it and start the command again, or give its key another name"
        )
    if known is None:
        write_digest(one.path, digest)
    return f"{one.path}: already there, {_trust(model, digest)}"


def _trust(model: PublishedModel, digest: str) -> str:
    if model.sha256:
        return f"SHA-256 as published ({digest})"
    return f"SHA-256 {digest} (none is published: this one is stored, and later copies must have it)"


def _entry(one: Needed) -> str:
    rows = [("file", f"{one.path}: {_state(one)}")]
    if one.published:
        model = one.published
        rows += [
            ("address", model.address),
            ("license", model.license),
            ("size", f"{model.megabytes:,.1f} MB"),
        ]
        rows.append(("SHA-256", model.sha256 or "none is published; that of the first download is stored"))
    elif one.package or one.path in SMALL_FILES.values():
        rows.append(("license", one.package.license if one.package else OWN_LICENSE))
    if not one.missing and not (one.published and one.published.sha256):
        rows.append(("its SHA-256", content_hash(one.path)))
        if not one.published:
            rows.append(("size", f"{one.path.stat().st_size / 1e6:,.1f} MB"))
    return "\n".join(
        [f"{one.key}: {one.name}" if one.key else one.name, *(f"  {what:<13}{text}" for what, text in rows)]
    )


def _state(one: Needed) -> str:
    if not one.missing:
        known = one.published and (one.published.sha256 or stored_digest(one.path))
        if known and content_hash(one.path) != known:
            return "THERE, BUT DAMAGED OR ANOTHER FILE (its SHA-256 differs)"
        return "there, SHA-256 verified" if known else "there"
    return "missing"
