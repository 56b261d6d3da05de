"""The checkpoints that a configuration needs: where they lie, their license, size and digest, and how to fetch them."""

import functools
import os
import shlex
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from egosplat.errors import UserError, reraise_as
from egosplat.files import alone, atomic_file, expand_home, write_text
from egosplat.models.checkpoints import CLIP, PHOTO_WEIGHTS, PHOTOS, SAM2, SENTENCES, content_hash
from egosplat.models.suitability import configured_checkpoints
from egosplat.pipeline.model_sets import CATALOGUE, PublishedModel, hub, locate_checkpoints, named_model
from egosplat.progress import log

_BUNDLED = {f"models.{model.checkpoint_key}": model.bundled for model in (SAM2, CLIP)}


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
    if bundled := _BUNDLED.get(key, {}).get(value):
        return [Needed(key, bundled, "bundled with egosplat", "Apache-2.0")]
    if value == PHOTOS:
        title, both = "{0.title}, of the Python package {0.name}", (PHOTO_WEIGHTS, SENTENCES)
        return [Needed(key, each.find(), title.format(each), each.license) for each in both]
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
    head = f"{file.key}: {file.name}".removeprefix(": ")
    return "\n".join([head, *(f"  {what:<13}{text}" for what, text in rows.items())])


def download(files: Sequence[Needed]) -> None:
    """Fetch what is missing of published checkpoints, through the cache of ``huggingface_hub``, and verify what is there; UserError:
    one cannot be fetched, with the addresses of all that are missing, or is another one."""
    missing = [file for file in files if file.missing]
    by_hand = [f"{file.published.address} -> {file.path}" for file in missing if file.published]
    if total := sum(file.published.megabytes for file in missing if file.published):
        log(f"{total:,.0f} MB are fetched once. After Ctrl-C or an error the same command goes on")
    try:
        for file in files:
            if file.published:
                if file in missing:
                    _fetch(file.published, file.path, by_hand)
                _check_digest(file.published.sha256, file.path)
            elif file in missing:
                raise UserError(f"{file.key}: there is no file {file.path}, and the catalogue has none")
    finally:
        _find_on_hub.cache_clear()  # addresses of files expire


def why_unreachable(files: Sequence[Needed]) -> str | None:
    """Why no hub answers, where one of missing published files is still to be fetched from it; None if it does."""
    from huggingface_hub.errors import HfHubHTTPError

    for model in [file.published for file in files if file.missing and file.published]:
        try:
            with reraise_as(lambda error, model=model: _fault(model, error)):
                _ = _in_cache(model) or _find_on_hub(model, hub())
        except UserError as told:
            # An answer with a status is for the download to tell.
            return None if isinstance(told.__cause__, HfHubHTTPError) else str(told)
    return None


def _fault(model: PublishedModel, error: Exception, advice: str = "") -> UserError:
    reason = str(error.__cause__ or error).partition("\n")[0].rstrip(".") or type(error).__name__
    names = [name for name in os.environ if name == "HF_ENDPOINT" or name.lower().endswith("_proxy")]
    through = f" (with {', '.join(sorted(names))} set)" if names else ""
    return UserError(f"{model.address}: cannot be fetched: {reason}{through}{advice}")


def _in_cache(model: PublishedModel) -> Path | None:
    """A file in the cache of ``huggingface_hub``, which other programs share; None if it is not there."""
    from huggingface_hub import try_to_load_from_cache

    found = try_to_load_from_cache(**model.on_hub)
    return Path(found).resolve() if isinstance(found, str) else None


@functools.cache
def _find_on_hub(model: PublishedModel, endpoint: str) -> Any:
    """What a hub tells of a file, an ``HfFileMetadata``; it is asked once for a download (UserError: what answers is
    no hub)."""
    from huggingface_hub import get_hf_file_metadata, hf_hub_url

    found = get_hf_file_metadata(hf_hub_url(**model.on_hub, endpoint=endpoint))
    if not (found.etag and found.commit_hash):
        raise UserError("what answers is no Hugging Face hub, perhaps the sign-in page of a network")
    return found


def _fetch(model: PublishedModel, path: Path, by_hand: Sequence[str]) -> None:
    """Download a checkpoint; it appears under its name verified, or not at all."""
    ways = f"The same command goes on. By hand: {'; '.join(by_hand)}; or without: models.set=photos"
    about = f"license: {model.license}; published SHA-256: {model.sha256 or 'none'}"
    log(f"{path.name}: {model.megabytes:,.0f} MB from {model.address} ({about})")
    with reraise_as(lambda error: _fault(model, error, f".\n{ways}")):
        fetched = _in_cache(model) or _fill_cache(model)
    # A large file is named there by its digest, as the hub tells it.
    told = fetched.name if len(fetched.name) == 64 else None
    try:
        _check_digest(model.sha256 or told, fetched)
    except UserError:
        fetched.unlink()  # else the cache would give it again
        raise
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(fetched, path)
    except OSError:  # the cache is on another file system
        with atomic_file(path) as scratch:
            shutil.copyfile(fetched, scratch)


def _fill_cache(model: PublishedModel) -> Path:
    """Fetch a file into the cache of ``huggingface_hub``, which itself begins anew after an interruption."""
    from huggingface_hub import constants
    from huggingface_hub.file_download import http_get, repo_folder_name
    from huggingface_hub.utils import build_hf_headers

    found = _find_on_hub(model, hub())
    names = {name: model.on_hub[name] for name in ("repo_id", "repo_type")}
    folder = Path(constants.HF_HUB_CACHE, repo_folder_name(**names))
    blob = folder / "blobs" / found.etag
    # A token is for the hub alone, not for the servers behind it.
    headers = build_hf_headers() if found.location.startswith(hub()) else None
    with alone(blob.parent, f"the download of {model.file}"):
        if not blob.exists():
            part = blob.with_suffix(".egosplat.incomplete")
            with open(part, "ab") as file:
                http_get(
                    found.location, file, resume_size=file.tell(), headers=headers, expected_size=found.size
                )
            part.rename(blob)
        # What the library looks for: the commit of a branch, and the file's name there.
        link = folder / "snapshots" / found.commit_hash / model.remote
        write_text(folder / "refs" / model.revision, found.commit_hash)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(os.path.relpath(blob, link.parent))
    return blob


def _check_digest(published: str | None, path: Path) -> None:
    """UserError if a file has not the published digest, where one is known."""
    digest = content_hash(path)
    if published not in (None, digest):
        raise UserError(
            f"{path}: has SHA-256 {digest}, published is {published}: it is damaged, or another file.\n"
            "Remove it and start the command again, or give its key another name"
        )
