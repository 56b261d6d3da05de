"""Fetch a published checkpoint from the Hugging Face hub, verify its digest, and replace nothing."""

import contextlib
import hashlib
import os
import shutil
from pathlib import Path

from egosplat.errors import NO_ROOM, UserError
from egosplat.files import atomic_file, scratch_directory
from egosplat.pipeline.published import PublishedModel, hub

# Names of httpx's errors for addresses that it cannot use.
_MALFORMED = ("InvalidURL", "UnsupportedProtocol")


class OfflineError(UserError):
    """No connection to the hub."""


def fetch(model: PublishedModel, path: Path) -> str:
    """Download a checkpoint. It appears under its name complete and verified, or not at all.

    Proxies are those of the environment (``https_proxy``, ``no_proxy``). ``PATH.sha256`` holds the digest, as ``sha256sum``
    writes it.

    Args:
        path: must not exist.

    Returns:
        The digest, 64 hexadecimal digits.

    Raises:
        OfflineError: the hub cannot be reached.
        UserError: the hub refuses, the connection breaks, an address is malformed, the disk is too small, or the digest is
            wrong.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _check_room(model, path)
    with scratch_directory(f".{path.name}.", path.parent) as folder:
        fetched = _fetched(model, path, folder)
        with fetched.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if model.sha256 not in (None, digest):
            raise UserError(
                f"{model.address}: the file has SHA-256 {digest}, published is {model.sha256}: it is damaged, or another "
                "file.\nIt is removed. Start the command again; if that does not help, report it"
            )
        os.replace(fetched, path)
    write_digest(path, digest)
    return digest


def stored_digest(path: Path) -> str | None:
    """Get the digest that was stored when a file was fetched; None if there is none."""
    with contextlib.suppress(OSError, ValueError):
        words = _beside(path).read_text(encoding="utf-8").split()
        return words[0] if words else None
    return None


def write_digest(path: Path, digest: str) -> None:
    """Store the digest of a file next to it, for ``sha256sum --check``."""
    with atomic_file(_beside(path)) as scratch:
        scratch.write_text(f"{digest}  {path.name}\n", encoding="utf-8")


def _fetched(model: PublishedModel, path: Path, folder: Path) -> Path:
    """Download a checkpoint into a folder."""
    from huggingface_hub import hf_hub_download
    from huggingface_hub.errors import HfHubHTTPError, HTTPError, LocalEntryNotFoundError

    try:
        place = (model.repository, model.remote)
        return Path(hf_hub_download(*place, revision=model.revision, local_dir=folder, endpoint=hub()))
    except (LocalEntryNotFoundError, HfHubHTTPError) as error:
        cause = error if isinstance(error, HfHubHTTPError) else error.__cause__ or error
        if isinstance(cause, HfHubHTTPError):
            answer = f"the hub answers {cause.response.status_code} {cause.response.reason_phrase}".rstrip()
            advice = f"Fetch it with a browser, and put it at {path}"
            raise UserError(f"{model.address}: {answer}. {advice}") from None
        through = f", by {' and '.join(settings)}" if (settings := _settings()) else ""
        raise OfflineError(f"{model.address}: no connection ({_first_line(cause)}){through}") from None
    except OSError as error:
        if error.errno in NO_ROOM:
            raise UserError(f"{path}: {error.strerror}. {_make_room()}") from None
        raise
    except Exception as error:
        # Malformed addresses and numbers of an answer, and proxies that cannot be used, have no class in common.
        if isinstance(error, (ValueError, ImportError)) or type(error).__name__ in _MALFORMED:
            raise UserError(f"{model.address}: {_first_line(error)}. {_check_settings(path)}") from None
        if not isinstance(error, (HTTPError, RuntimeError)):  # of the hub's two protocols, HTTP and Xet
            raise
        advice = "Start the command again"
        raise UserError(
            f"{model.address}: the connection broke off ({_first_line(error)}). {advice}"
        ) from None


def _settings() -> list[str]:
    """The set variables that name a hub or a proxy."""
    proxies = (f"{scheme}_proxy" for scheme in ("http", "https", "all"))
    names = ("HF_ENDPOINT", *(name for proxy in proxies for name in (proxy, proxy.upper())))
    return [name for name in names if os.environ.get(name)]


def _check_settings(path: Path) -> str:
    """What to do about an address that cannot be used: it comes from the environment, or from the hub."""
    by_hand = f"fetch the file with a browser, and put it at {path}"
    return (
        f"Correct {' or '.join(settings)}, or {by_hand}"
        if (settings := _settings())
        else by_hand[0].upper() + by_hand[1:]
    )


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


def _check_room(model: PublishedModel, path: Path) -> None:
    free = shutil.disk_usage(path.parent).free / 1e6
    if free < model.megabytes:
        raise UserError(f"{path}: needs {model.megabytes:,.1f} MB, {free:,.1f} MB are free. {_make_room()}")


def _make_room() -> str:
    return "Make room, or set models.cache to a folder on another disk"


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")
