"""The checkpoints that a configuration needs: where they lie, their license, size and digest, and how to fetch them."""

import os
import shlex
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError, reraise_as
from egosplat.files import atomic_file, expand_home
from egosplat.models.checkpoints import CLIP, SAM2, content_hash
from egosplat.models.configs import PHOTO_WEIGHTS, PHOTOS, SENTENCES, SMALL
from egosplat.models.suitability import configured_checkpoints
from egosplat.pipeline.model_sets import CATALOGUE, PublishedModel, hub, locate_checkpoints, named_model
from egosplat.progress import log

_SMALL_FILES = {model.checkpoint_key: model.small for model in (SAM2, CLIP)}

# License of the bundled checkpoints, which is egosplat's own.
_OWN_LICENSE = "Apache-2.0"


@dataclass(frozen=True)
class Needed:
    """A file with weights.

    Attributes:
        key: the configuration key that names it; empty for one that only the catalogue has.
        name: the model in a few words.
        license: None if it is not known.
        published: its entry of the catalogue; None for other files.
    """

    key: str
    path: Path
    name: str
    license: str | None = None
    published: PublishedModel | None = None

    @property
    def missing(self) -> bool:
        return not self.path.is_file()


def find_needed(configs: Iterable[Mapping[str, Any]]) -> list[Needed]:
    """List the checkpoints that configurations need, each once; UserError if a package or a published one is missing."""
    found: dict[Path, Needed] = {}
    for config in map(locate_checkpoints, configs):
        named = {f"models.{key}": value for key, value in configured_checkpoints(config).items()}
        named["transient.encoder_weights"] = config["transient"]["encoder_weights"]
        for key, value in named.items():
            for file in [] if value is None else _files(key, value):
                found.setdefault(file.path, file)
    return list(found.values())


def _files(key: str, value: str) -> list[Needed]:
    if value == PHOTOS:
        packages = (PHOTO_WEIGHTS, SENTENCES)
        names = [f"{package.title}, of the Python package {package.name}" for package in packages]
        return [Needed(key, p.find(), name, p.license) for p, name in zip(packages, names, strict=True)]
    if value == SMALL:
        return [Needed(key, _SMALL_FILES[key.partition(".")[2]], "bundled with egosplat", _OWN_LICENSE)]
    path = expand_home(value)
    model = next((model for model in CATALOGUE if model.file == path.name), None)
    return [_published(key, path, model) if model else Needed(key, path, "your own file")]


def _published(key: str, path: Path, model: PublishedModel) -> Needed:
    return Needed(key, path, f"{model.library} {model.architecture}, {model.weights}", model.license, model)


def catalogue(config: Mapping[str, Any], names: Sequence[str] = ()) -> list[Needed]:
    """List checkpoints of the catalogue, by architecture or file, in ``models.cache``; UserError for an unknown name."""
    cache = expand_home(config["models"]["cache"])
    models = [named_model(name) for name in names] or CATALOGUE
    return [_published("", cache / model.file, model) for model in models]


def listing(files: Sequence[Needed], options: Sequence[str] = ()) -> str:
    """Describe files, hashed if they are there; the command that fetches the others repeats the ``options``."""
    parts = [_entry(file) for file in files]
    missing = [file for file in files if file.missing]
    if fetchable := [file.published for file in missing if file.published]:
        total = sum(model.megabytes for model in fetchable)
        names = [] if files[0].key else [model.architecture for model in fetchable]
        command = shlex.join(["egosplat", "models", "download", *names, *options])
        parts.append(f"{len(fetchable)} of {len(files)} files are to be fetched, {total:,.0f} MB: {command}")
    elif not missing:
        parts.append("Nothing is missing.")
    return "\n\n".join(parts)


def _entry(file: Needed) -> str:
    digest, model = None if file.missing else content_hash(file.path), file.published
    rows = {"file": f"{file.path}: {_state(file, digest)}"}
    if model:
        rows |= {"address": model.address, "license": model.license, "size": f"{model.megabytes:,.1f} MB"}
        rows["SHA-256"] = model.sha256 or "none is published"
    elif file.license:
        rows["license"] = file.license
    if digest and not (model and model.sha256):
        rows["its SHA-256"] = digest
    if digest and not model:
        rows["size"] = f"{file.path.stat().st_size / 1e6:,.1f} MB"
    head = f"{file.key}: {file.name}" if file.key else file.name
    return "\n".join([head, *(f"  {what:<13}{text}" for what, text in rows.items())])


def _state(file: Needed, digest: str | None) -> str:
    if digest is None:
        return "missing"
    if not (file.published and file.published.sha256):
        return "there"
    verified = digest == file.published.sha256
    return (
        "there, SHA-256 verified" if verified else "THERE, BUT DAMAGED OR ANOTHER FILE (its SHA-256 differs)"
    )


def download(files: Sequence[Needed]) -> list[str]:
    """Fetch what is missing of published checkpoints, and verify what is there; a line for each file.

    Files come through the cache of ``huggingface_hub``, which resumes. Proxies are those of the environment.

    Raises:
        UserError: a file cannot be fetched, or is not the published one; with the addresses and places of all that are missing.
    """
    by_hand = [
        f"{file.published.address} -> {file.path}" for file in files if file.published and file.missing
    ]
    lines = []
    for file in files:
        if file.published is None:
            if file.missing:
                raise UserError(
                    f"{file.key}: there is no file {file.path}, and egosplat's catalogue does not have it"
                )
            lines.append(f"{file.path}: {file.name}")
            continue
        told = "fetched" if file.missing else "already there"
        if file.missing:
            _fetch(file.published, file.path, by_hand)
        digest = content_hash(file.path)
        _check_digest(file.published, file.path, digest)
        trust = f"as published ({digest})" if file.published.sha256 else f"{digest} (none is published)"
        lines.append(f"{file.path}: {told}, SHA-256 {trust}")
    return lines


def _fetch(model: PublishedModel, path: Path, by_hand: Sequence[str]) -> None:
    """Download a checkpoint; it appears under its name verified, or not at all."""
    from huggingface_hub import hf_hub_download

    def describe(error: Exception) -> UserError:
        reason = str(error.__cause__ or error).partition("\n")[0].rstrip(".") or type(error).__name__
        names = [name for name in os.environ if name == "HF_ENDPOINT" or name.lower().endswith("_proxy")]
        through = f" (with {', '.join(sorted(names))} set)" if names else ""
        return UserError(
            f"{model.address}: cannot be fetched: {reason}{through}.\nFetch by hand: {'; '.join(by_hand)}"
        )

    log(f"{path.name}: {model.megabytes:,.0f} MB from {model.address} (license: {model.license})")
    with reraise_as(describe):
        cached = hf_hub_download(model.repository, model.remote, revision=model.revision, endpoint=hub())
    fetched = Path(cached).resolve()
    try:
        _check_digest(model, fetched, content_hash(fetched))
    except UserError:
        fetched.unlink()  # else the cache would give it again
        raise
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(fetched, path)
    except OSError:  # the cache is on another file system
        with atomic_file(path) as scratch:
            shutil.copyfile(fetched, scratch)


def _check_digest(model: PublishedModel, path: Path, digest: str) -> None:
    if model.sha256 not in (None, digest):
        raise UserError(
            f"{path}: has SHA-256 {digest}, published is {model.sha256}: it is damaged, or another file.\n"
            "Remove it and start the command again, or give its key another name"
        )
