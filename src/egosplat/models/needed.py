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
from egosplat.models.checkpoints import CLIP, PHOTO_WEIGHTS, PHOTOS, SAM2, SENTENCES, SMALL, content_hash
from egosplat.models.suitability import configured_checkpoints
from egosplat.pipeline.model_sets import CATALOGUE, PublishedModel, hub, locate_checkpoints, named_model
from egosplat.progress import log

_SMALL_FILES = {f"models.{model.checkpoint_key}": model.small for model in (SAM2, CLIP)}


@dataclass(frozen=True)
class Needed:
    """A file with weights: its key, empty if only the catalogue has it; the model in a few words; its license, if it is known;
    and its entry of the catalogue."""

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
        title = "{0.title}, of the Python package {0.name}"
        return [
            Needed(key, each.find(), title.format(each), each.license) for each in (PHOTO_WEIGHTS, SENTENCES)
        ]
    if value == SMALL:
        return [Needed(key, _SMALL_FILES[key], "bundled with egosplat", "Apache-2.0")]
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
    state = "missing" if digest is None else "there"
    if digest and model and model.sha256:
        damaged = "THERE, BUT DAMAGED OR ANOTHER FILE (its SHA-256 differs)"
        state = "there, SHA-256 verified" if digest == model.sha256 else damaged
    rows = {"file": f"{file.path}: {state}"}
    if model:
        rows |= {"address": model.address, "license": model.license, "size": f"{model.megabytes:,.1f} MB"}
        rows["SHA-256"] = model.sha256 or "none is published"
    elif file.license:
        rows["license"] = file.license
    if digest and not (model and model.sha256):
        rows["its SHA-256"] = digest
    if digest and not model:
        rows["size"] = f"{file.path.stat().st_size / 1e6:,.1f} MB"
    return "\n".join(
        [
            f"{file.key}: {file.name}".removeprefix(": "),
            *(f"  {what:<13}{text}" for what, text in rows.items()),
        ]
    )


def download(files: Sequence[Needed]) -> list[str]:
    """Fetch what is missing of published checkpoints, through the cache of ``huggingface_hub``, and verify what is there.

    Returns a line for each file (UserError: one cannot be fetched, with the addresses of all that are missing, or is another
    one).
    """
    missing = [file for file in files if file.missing]
    by_hand = [f"{file.published.address} -> {file.path}" for file in missing if file.published]
    lines = []
    for file in files:
        model, told = file.published, "already there"
        if file in missing:
            if model is None:
                wrong = f"there is no file {file.path}, and egosplat's catalogue does not have it"
                raise UserError(f"{file.key}: {wrong}")
            _fetch(model, file.path, by_hand)
            told = "fetched"
        if model is None:
            lines.append(f"{file.path}: {file.name}")
            continue
        digest = _checked_digest(model, file.path)
        trust = f"as published ({digest})" if model.sha256 else f"{digest} (none is published)"
        lines.append(f"{file.path}: {told}, SHA-256 {trust}")
    return lines


def _fetch(model: PublishedModel, path: Path, by_hand: Sequence[str]) -> None:
    """Download a checkpoint; it appears under its name verified, or not at all."""
    from huggingface_hub import hf_hub_download

    def describe(error: Exception) -> UserError:
        reason = str(error.__cause__ or error).partition("\n")[0].rstrip(".") or type(error).__name__
        names = [name for name in os.environ if name == "HF_ENDPOINT" or name.lower().endswith("_proxy")]
        through = f" (with {', '.join(sorted(names))} set)" if names else ""
        told = f"{model.address}: cannot be fetched: {reason}{through}."
        return UserError(f"{told}\nFetch by hand: {'; '.join(by_hand)}")

    log(f"{path.name}: {model.megabytes:,.0f} MB from {model.address} (license: {model.license})")
    with reraise_as(describe):
        cached = hf_hub_download(model.repository, model.remote, revision=model.revision, endpoint=hub())
    fetched = Path(cached).resolve()
    try:
        _checked_digest(model, fetched)
    except UserError:
        fetched.unlink()  # else the cache would give it again
        raise
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(fetched, path)
    except OSError:  # the cache is on another file system
        with atomic_file(path) as scratch:
            shutil.copyfile(fetched, scratch)


def _checked_digest(model: PublishedModel, path: Path) -> str:
    """SHA-256 of a file; UserError if it is not the published one."""
    digest = content_hash(path)
    if model.sha256 not in (None, digest):
        raise UserError(
            f"{path}: has SHA-256 {digest}, published is {model.sha256}: it is damaged, or another file.\n"
            "Remove it and start the command again, or give its key another name"
        )
    return digest
