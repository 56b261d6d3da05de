"""A download continues where it broke off, is verified, and never leaves a wrong file under its name."""

import hashlib
import random
import subprocess
import sys
import threading
from collections import namedtuple
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.models import download
from egosplat.models.download import OfflineError, fetch, fetched_bytes, stored_digest
from tests.support.file_server import FileServer
from tests.support.waiting import wait_for

CONTENT = random.Random(0).randbytes(3 * 2**20 + 12345)
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch):
    """Attempts follow each other at once."""
    monkeypatch.setattr(download, "PAUSE_S", 0.0)


@pytest.fixture
def server():
    with FileServer(CONTENT) as running:
        yield running


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "cache" / "model.pt"


def is_whole(path: Path) -> bool:
    """Whether the file is there with its digest, and nothing else is left in its folder."""
    names = sorted(file.name for file in path.parent.iterdir())
    return path.read_bytes() == CONTENT and names == [path.name, f"{path.name}.sha256"]


@pytest.mark.parametrize("expected", [SHA256, None])
def test_a_file_is_fetched_and_its_digest_is_stored(server, path, expected):
    """The folder is made; the digest is stored in the format of sha256sum."""
    assert fetch(server.address, path, expected) == SHA256
    assert is_whole(path) and stored_digest(path) == SHA256
    subprocess.run(["sha256sum", "--check", f"{path.name}.sha256"], cwd=path.parent, check=True)


def test_a_broken_connection_continues_where_it_broke_off(server, path):
    """Neither a cut connection nor a busy server loses the bytes that are here."""
    server.breaks, server.statuses = [2**20 + 7, 1000], [200, 503]
    fetch(server.address, path, SHA256)
    assert is_whole(path)
    assert [asked for _, asked in server.requests] == [
        None,
        "bytes=1048583-",
        "bytes=1048583-",
        "bytes=1049583-",
    ]


def test_a_truncated_file_is_an_error_that_the_next_call_continues(server, path, monkeypatch):
    """A server that always closes early gives no file; its bytes are kept."""
    monkeypatch.setattr(download, "ATTEMPTS", 2)
    server.breaks = [100, 100]
    with pytest.raises(UserError, match=r"broke off at .* MB, 2 times.*continues"):
        fetch(server.address, path, SHA256)
    assert not path.exists() and fetched_bytes(path) == 200
    fetch(server.address, path, SHA256)
    assert is_whole(path) and server.requests[-1][1] == "bytes=200-"


@pytest.mark.parametrize("expected", [SHA256, None])
def test_a_killed_download_continues(server, path, expected):
    """kill -9 in the middle: the bytes on the disk are used, and the file is whole."""
    server.breaks, server.stall = [2 * 2**20], threading.Event()
    code = "import sys; from pathlib import Path; from egosplat.models.download import fetch; "
    code += "fetch(sys.argv[1], Path(sys.argv[2]), sys.argv[3] or None)"
    words = [sys.executable, "-c", code, server.address, str(path), expected or ""]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: fetched_bytes(path) >= 2**20)
    finally:
        process.kill()
        process.wait()
    server.stall.set()
    here = fetched_bytes(path)
    assert here >= 2**20 and not path.exists()
    assert fetch(server.address, path, expected) == SHA256
    assert is_whole(path) and server.requests[-1][1] == f"bytes={here}-"


def test_a_download_that_was_killed_before_the_new_name_is_completed(server, path):
    """All bytes are here; the server answers 416."""
    path.parent.mkdir()
    path.with_name("model.pt.part").write_bytes(CONTENT)
    fetch(server.address, path, SHA256)
    assert is_whole(path) and len(server.requests) == 1


@pytest.mark.parametrize("left", [CONTENT[:999], CONTENT + b"more", b"another file"])
@pytest.mark.parametrize("ranges", [True, False])
def test_without_a_published_digest_bytes_of_another_version_are_not_used(server, path, left, ranges):
    """The ETag of the bytes that are here is of an older version, or unknown: the download starts again."""
    server.ranges = ranges
    path.parent.mkdir()
    path.with_name("model.pt.part").write_bytes(left)
    path.with_name("model.pt.etag").write_text('"0"')
    assert fetch(server.address, path, None) == SHA256 and is_whole(path)


def test_a_server_without_ranges_sends_everything_again(server, path):
    """The file is not appended to itself."""
    server.ranges, server.breaks = False, [2**20]
    fetch(server.address, path, SHA256)
    assert is_whole(path)


def test_a_wrong_digest_leaves_nothing(server, path):
    """A damaged file must not be continued or loaded; both digests are named."""
    with pytest.raises(UserError, match=f"(?s){SHA256}.*{'0' * 64}"):
        fetch(server.address, path, "0" * 64)
    assert list(path.parent.iterdir()) == []


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_refusal_ends_at_once(server, path, status):
    """Another attempt would not help."""
    server.statuses = [status] * 9
    with pytest.raises(UserError, match=f"{server.address}.* {status} "):
        fetch(server.address, path, SHA256)
    assert len(server.requests) == 1 and not path.exists()


def test_a_busy_server_is_asked_a_few_times(server, path):
    """An overloaded server gives an error in the end."""
    server.statuses = [503] * 99
    with pytest.raises(UserError, match=f"503 .*, {download.ATTEMPTS} times"):
        fetch(server.address, path, SHA256)
    assert len(server.requests) == download.ATTEMPTS


def test_a_web_page_is_no_checkpoint(server, path):
    """A portal that asks for a log-in answers 200."""
    server.kind = "text/html"
    with pytest.raises(UserError, match="web page"):
        fetch(server.address, path, None)
    assert not path.exists() and fetched_bytes(path) == 0


def test_a_file_of_unknown_size_needs_a_published_digest(server, path):
    """Nothing else could tell that it is complete."""
    server.length = False
    with pytest.raises(UserError, match="size"):
        fetch(server.address, path, None)
    fetch(server.address, path, SHA256)
    assert is_whole(path)


def test_a_disk_that_is_too_small_is_told_before_the_download(server, path, monkeypatch):
    """No minutes are spent on a file that does not fit."""
    usage = namedtuple("usage", "total used free")(1, 1, 2**20)
    monkeypatch.setattr(download.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(UserError, match=r"needs 3\.2 MB, 1\.0 MB are free.*models\.cache"):
        fetch(server.address, path, SHA256)
    assert not path.exists()


def test_a_disk_that_fills_up_keeps_the_bytes(server, path):
    """A limit on the size of files stands in for a full disk: the error is the user's, the bytes are kept."""
    code = (
        "import resource, signal, sys; from pathlib import Path; from egosplat.errors import UserError\n"
        "from egosplat.models.download import fetch\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))\n"
        "try: fetch(sys.argv[1], Path(sys.argv[2]), None)\n"
        "except UserError as error: print(error)\n"
    )
    words = [sys.executable, "-c", code, server.address, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert "Make room" in done.stdout and str(path) in done.stdout
    assert not path.exists() and fetched_bytes(path) == 2**20
    assert fetch(server.address, path, None) == SHA256 and server.requests[-1][1] == "bytes=1048576-"


def test_no_connection_is_told_at_once(path):
    """Offline, nobody waits for five attempts."""
    with FileServer(CONTENT) as gone:
        address = gone.address
    with pytest.raises(OfflineError, match="no connection"):
        fetch(address, path, SHA256)
    assert list(path.parent.iterdir()) == []


def test_a_proxy_of_the_environment_is_used(path, monkeypatch):
    """Many machines reach the network through a proxy only."""
    with FileServer(CONTENT) as proxy:
        monkeypatch.setenv("http_proxy", proxy.address)
        monkeypatch.delenv("no_proxy", raising=False)
        monkeypatch.delenv("NO_PROXY", raising=False)
        fetch("http://models.example/model.pt", path, SHA256)
        assert proxy.requests == [("http://models.example/model.pt", None)]
    assert is_whole(path)


def test_two_downloads_of_one_file_do_not_mix(server, path):
    """The second ends with an error while the first runs."""
    server.breaks, server.stall = [2**20], threading.Event()
    first = threading.Thread(target=fetch, args=(server.address, path, SHA256))
    first.start()
    wait_for(lambda: fetched_bytes(path) >= 2**20)
    with pytest.raises(UserError, match="another process"):
        fetch(server.address, path, SHA256)
    server.stall.set()
    first.join()
    assert is_whole(path)


def test_a_file_that_is_there_is_not_replaced(server, path):
    """The function is asked only for missing files; a race leaves the first one."""
    path.parent.mkdir()
    path.write_bytes(b"mine")
    with pytest.raises(UserError, match="start the command again"):
        fetch(server.address, path, SHA256)
    assert path.read_bytes() == b"mine" and stored_digest(path) is None
