"""A download appears under its name whole and verified, or not at all, and an error names a remedy."""

import errno
import hashlib
import os
import shutil
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.models.download import OfflineError, fetch, stored_digest
from egosplat.pipeline.published import PublishedModel, named_model
from tests.support.hub import Hub

CONTENT = b"weights " * 1000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def hub(monkeypatch):
    with Hub(CONTENT, monkeypatch) as running:
        yield running


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "cache" / "model.pt"


def model(sha256: str | None = SHA256) -> PublishedModel:
    return replace(named_model("ViT-B-16"), sha256=sha256, megabytes=1)


def test_a_file_is_fetched_whole_with_its_digest(hub, path):
    """From repository, revision and name; nothing else is left in the folder."""
    assert fetch(model(), path) == SHA256 == stored_digest(path)
    assert path.read_bytes() == CONTENT
    (address,) = hub.requests
    assert address == model().address
    assert address.endswith("/laion/CLIP-ViT-B-16-laion2B-s34B-b88K/resolve/main/open_clip_pytorch_model.bin")
    assert {file.name for file in path.parent.iterdir()} == {"model.pt", "model.pt.sha256"}


def test_a_model_of_a_fixed_revision_is_fetched_from_there(hub, path):
    fetch(replace(named_model("mobilenetv3_small_050"), sha256=SHA256), path)
    assert "/resolve/f58e7345afe2832abd6f81cc60f67cd1ddf7ce00/" in hub.requests[0]


def test_a_file_without_published_digest_is_accepted(hub, path):
    assert fetch(model(sha256=None), path) == SHA256 == stored_digest(path)


def test_a_file_with_another_digest_is_removed(hub, path):
    with pytest.raises(UserError, match=SHA256) as caught:
        fetch(model(sha256="0" * 64), path)
    assert "0" * 64 in str(caught.value) and str(caught.value).count("\n") == 1
    assert list(path.parent.iterdir()) == []


def test_a_refusal_is_one_line_with_the_address_and_the_place(hub, path):
    hub.status = 404
    with pytest.raises(UserError) as caught:
        fetch(model(), path)
    message = str(caught.value)
    assert message.startswith(model().address) and "404" in message and str(path) in message
    assert "\n" not in message and not path.exists()


@pytest.mark.parametrize("offline", [False, True])
def test_without_a_connection_the_error_has_the_address(hub, path, monkeypatch, offline):
    """The hub's library answers without network if ``HF_HUB_OFFLINE`` asks for that."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", offline)
    # The library repeats the first question for seconds.
    monkeypatch.setattr("huggingface_hub.utils._http.time.sleep", lambda seconds: None)
    hub.stop()
    with pytest.raises(OfflineError, match=model().address):
        fetch(model(), path)
    assert list(path.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("status", "headers", "environment", "named"),
    [
        (200, {"Content-Length": "abc"}, {}, "Content-Length"),
        (200, {"Content-Length": "-5"}, {}, "Content-Length"),
        (302, {"Location": "http://[bad"}, {}, "put it at"),
        (302, {"Location": "ftp://somewhere/else"}, {}, "ftp://"),
        (200, {}, {"http_proxy": "http://127.0.0.1:port"}, "http_proxy"),
        (200, {}, {"http_proxy": "ftp://127.0.0.1:1"}, "http_proxy"),
        (200, {}, {"http_proxy": "socks5://127.0.0.1:1"}, "http_proxy"),
        (200, {}, {"http_proxy": "http://127.0.0.1:1"}, "http_proxy"),
        (200, {}, {"HF_ENDPOINT": "nowhere"}, "HF_ENDPOINT"),
        (200, {}, {"HF_ENDPOINT": "http://nowhere:port"}, "HF_ENDPOINT"),
    ],
)
def test_malformed_answers_and_addresses_are_one_line(
    hub, path, monkeypatch, status, headers, environment, named
):
    """Of the hub, of a proxy and of the environment; nothing is left."""
    import huggingface_hub

    monkeypatch.setattr("huggingface_hub.utils._http.time.sleep", lambda seconds: None)
    hub.status, hub.headers = status, headers
    for name, value in ({"no_proxy": "", "NO_PROXY": ""} | environment).items():
        monkeypatch.setenv(name, value)
    # The library reads proxies when it first connects.
    huggingface_hub.close_session()
    with pytest.raises(UserError, match=named) as caught:
        fetch(model(), path)
    huggingface_hub.close_session()
    assert "\n" not in str(caught.value) and list(path.parent.iterdir()) == []


def test_a_small_disk_is_an_error_before_the_download(hub, path, monkeypatch):
    usage = namedtuple("usage", "total used free")(10**9, 10**9, 10**5)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    with pytest.raises(UserError, match=r"1\.0 MB, 0\.1 MB .*models\.cache"):
        fetch(model(), path)
    assert hub.requests == []


@pytest.mark.parametrize(
    "error, told",
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "models.cache"),
        (RuntimeError("reset by peer\nmore"), "(reset by peer)"),
    ],
)
def test_an_error_during_the_download_leaves_nothing(path, monkeypatch, error, told):
    """A disk that others fill, and the errors of the library's transports."""

    def broken(*place: str, local_dir: Path, **_: object) -> None:
        (local_dir / "half").write_bytes(CONTENT[:100])
        raise error

    monkeypatch.setattr("huggingface_hub.hf_hub_download", broken)
    with pytest.raises(UserError) as caught:
        fetch(model(), path)
    assert told in str(caught.value) and "\n" not in str(caught.value)
    assert list(path.parent.iterdir()) == []


def test_what_a_killed_download_left_is_removed(hub, path):
    left = path.parent / f".{path.name}.left"
    left.mkdir(parents=True)
    (left / "half").write_bytes(CONTENT[:100])
    fetch(model(), path)
    assert not left.exists()
