"""``egosplat view`` without a browser: who may ask the server, and which page it serves."""

import http.client
import json
import shutil
import socket
import struct
from functools import partial
from urllib.parse import urlencode, urlsplit

import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.viewing import growing, words
from egosplat.viewing.command import open_page
from egosplat.viewing.html import facts_of
from egosplat.viewing.options import PageOptions
from egosplat.viewing.server import PageServer
from tests.support.page_scene import TITLE, put_page_scene
from tests.support.waiting import wait_for

# Stands for a page: a served one may ask its server.
PAGE = "<html lang=\"en\">default-src 'none';"


@pytest.fixture
def start(serve):
    """``start(host)``: a server that answers with what it was asked."""
    return partial(serve, PAGE, lambda **asked: asked)


def ask(server, path="/", method="GET", **headers):
    """Status and text of a request to 127.0.0.1."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1])
    connection.request(method, path, headers=headers)
    reply = connection.getresponse()
    return reply.status, reply.read().decode()


def test_a_served_page_may_ask_for_phrases(start):
    server = start()
    status, page = ask(server)
    assert status == 200 and "connect-src 'self';" in page
    path = page.partition('data-asking="')[2].partition('"')[0].replace("&amp;", "&")
    for method, kept in (("GET", ("phrase", "like")), ("POST", ("like", "name"))):
        asked = {"phrase": "café & bar", "like": "7", "name": "my mug"}
        status, told = ask(server, f"/{path}{urlencode(asked | {'x': 'y'})}", method)
        assert json.loads(told) == {key: asked[key] for key in kept}, "no link gives a name"
    assert ask(server, f"/{path}name=x", "POST", Origin="http://evil.example")[0] == 403
    assert ask(server, "/other")[0] == 404


HOST, OWN, EVIL = "Host: 127.0.0.1:1", "Origin: http://127.0.0.1:1", "Origin: http://evil.example"
EMBEDDED = "Sec-Fetch-Site: cross-site"
GOOD_HOSTS = ("localhost.", "127.0.0.1.:80", "  127.0.0.1\t", "127.0.0.1", "127.0.0.1:8080", "LOCALHOST")
SPACED = (
    "evil@127.0.0.1 evil.example:80@127.0.0.1 127.0.0.1/evil 127.0.0.1?evil 127.0.0.1#evil 127.0.0.1:port 127.0.0.1:-1 "
    "127.0.0.1: localhost.. evil.example 127.0.0.1.evil.example [127.0.0.1 [127.0.0.1] [::1] [::1%lo] 127.1 2130706433"
)
BAD_HOSTS = (*SPACED.split(), "local\thost", "127.0.0.1, evil", "", "l\xf6calhost", "a" * 60000)
ELSEWHERE = ("/../../etc/passwd", "/%2e%2e/etc/passwd", "//etc/passwd")
ELSEWHERE += ("/ask/", "/%61sk?phrase=x", "/;x", "/%00", "/\\evil", "/[")


@pytest.mark.parametrize(
    ("target", "headers", "status"),
    [
        *(("/", [f"Host: {host}"], 200) for host in GOOD_HOSTS),
        *(("/", [f"Host: {host}"], 403) for host in BAD_HOSTS),
        *(("/", hosts, 403) for hosts in ([], [HOST, HOST], [HOST, "Host: evil"], ["Host: evil", HOST])),
        ("/", [HOST, OWN], 200),
        ("/", ["Host: localhost:1", "Origin: http://localhost:1"], 200),
        ("/", ["Host: localhost:1", "Origin: http://localhost:2"], 403),
        *(
            (target, [host, origin], 403)
            for target in ("/", "/ask?phrase=x")
            for host, origin in ((HOST, EVIL), (HOST, "Origin: null"), ("Host: evil.example", OWN))
        ),
        *(("/", [HOST, *origins], 403) for origins in ([OWN, EVIL], [EVIL, OWN], [OWN, OWN], ["Origin:"])),
        *(("/", [HOST, f"{OWN}{more}"], 403) for more in ("/", ".evil.example", "0")),
        ("/", [HOST, EVIL, "Upgrade: websocket", "Connection: Upgrade"], 403),
        ("/ask?phrase=x", [HOST, "Sec-Fetch-Site: same-origin"], 200),
        ("/ask?phrase=x", [HOST, EMBEDDED, "Sec-Fetch-Mode: no-cors"], 403),
        ("/ask?phrase=x", [HOST, "Sec-Fetch-Site: same-site", "Sec-Fetch-Mode: no-cors"], 403),
        ("/", [HOST, EMBEDDED, "Sec-Fetch-Mode: navigate"], 200),
        *((target, [HOST], 403) for target in ("http://127.0.0.1:1/", "http://[/", "ask?phrase=x", "*")),
        *((target, [HOST], 404) for target in ELSEWHERE),
        ("/" + "a" * 70000, [HOST], 414),
        ("/", [HOST, "X: " + "a" * 70000], 431),
    ],
)
def test_a_browser_alone_is_answered(start, capfd, target, headers, status):
    server = start()
    with socket.create_connection(("127.0.0.1", server.server_address[1]), timeout=30) as connection:
        lines = [f"GET {target} HTTP/1.1", *headers, "", ""]
        connection.sendall("\r\n".join(lines).encode("latin-1"))
        assert connection.makefile("rb").readline().split()[1] == str(status).encode()
    assert capfd.readouterr().err == ""


def test_a_browser_that_leaves_early_says_nothing(start, capfd):
    server = start()
    connection = socket.create_connection(("127.0.0.1", server.server_address[1]))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.sendall(b"GET / HT")
    connection.close()
    assert ask(server)[0] == 200
    server.shutdown()
    server.server_close()
    assert capfd.readouterr().err == ""


def test_the_address_of_ipv6_is_in_brackets(start):
    try:
        server = start("::1")
    except UserError:
        pytest.skip("no IPv6 here")
    assert urlsplit(server.address).hostname == "::1" and not server.token
    expected = {"[::1]:1": b"200", "[::1]": b"200", "localhost": b"200", "::1": b"403", "[::1": b"403"}
    for host, status in expected.items():
        with socket.create_connection(("::1", server.server_address[1]), timeout=30) as connection:
            connection.sendall(f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            assert connection.makefile("rb").readline().split()[1] == status


def test_other_computers_need_the_token(start):
    server = start("0.0.0.0")
    address = urlsplit(server.address)
    assert address.hostname == socket.gethostname().lower() and len(server.token) > 20
    for query in ("", "?token=", "?token=x", f"?token={server.token}x", "?token=%C3%A9"):
        assert ask(server, f"/{query}")[0] == 403
    status, page = ask(server, f"/?{address.query}")
    assert status == 200 and f"ask?token={server.token}&amp;" in page
    assert ask(server, "/ask?phrase=x")[0] == 403
    elsewhere = {"Referer": server.address, "Cookie": address.query, "Authorization": server.token}
    assert {ask(server, **{name: value})[0] for name, value in elsewhere.items()} == {403}
    assert ask(server, f"/?{address.query}&token=x")[0] == 403
    assert ask(server, f"/?{address.query}", Host="evil.example")[0] == 403


def test_a_port_in_use_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"--port {port}"):
            PageServer("127.0.0.1", port)


def test_a_page_that_is_there_is_served_if_it_is_of_this_scene(tmp_path, page_scene, monkeypatch):
    """Another option, other artifacts or a file of somebody else: the page is made, and the file stays."""
    folder = shutil.copytree(page_scene, tmp_path / "scene")
    written = (folder / "scene.html").read_text()

    def served(**changes):
        return open_page(folder, PageOptions(device="cpu", **changes))[0]

    def title(page):
        return facts_of(page)["title"]

    assert served() == written and title(served(max_gaussians=5)) != TITLE
    for other in ("<!DOCTYPE html>mine", written[: len(written) // 2]):
        (folder / "scene.html").write_text(other)
        assert title(served()) != TITLE
    (folder / "scene.html").write_text(written)
    monkeypatch.setattr("tests.support.page_scene.WORDS", ("couch", "wall", "lamp"))
    put_page_scene(folder)
    assert title(served()) != TITLE and (folder / "scene.html").read_text() == written


def test_a_scene_in_the_making_shows_what_is_there(page_scene, tmp_path, monkeypatch):
    monkeypatch.setattr(growing, "_EVERY_S", 0.1)
    monkeypatch.setattr("webbrowser.open", print)
    drawn = {"frames": "contact_sheet", "instances": "instances_sheet"}
    with PageServer("127.0.0.1", 0) as server, growing.growing_page(server, tmp_path):
        for made in ("frames", "poses", "instances"):
            shutil.copytree(page_scene / f"{made}.zarr", tmp_path / f"{made}.zarr")
            wait_for(partial(lambda name: f'"{name}"' in ask(server, "/ask?")[1], drawn.get(made, "title")))
        (checkpoint := tmp_path / ".splats.zarr.checkpoint").mkdir()
        Image.new("RGB", (8, 4)).save(checkpoint / "training.png")
        wait_for(lambda: '"splats_sheet"' in ask(server, "/ask?")[1])
    assert open_page(page_scene, PageOptions(device="cpu"))[1]() == {}, "so its page takes its place"


def test_a_question_is_answered_with_a_vector_or_a_reason(page_scene, monkeypatch):
    _, answer = open_page(page_scene, PageOptions(device="cpu"))
    [red] = answer(phrase="where is my red couch?")["answers"]
    assert sum(value * value for value in red["vector"]) == pytest.approx(1) and red["asked"] == "red couch"
    reasons = {"coutch": 'mean "couch"?', "zeppelin": "zeppelin", " \u200b": "blank", "::": "no word"}
    for phrase, why in reasons.items():
        [told] = answer(phrase=phrase)["answers"]
        assert why in told["refusal"] and "vector" not in told and not told["things"]
    assert "no picture" in answer(like="7")["why"] or "view_features" in answer(like="7")["why"]
    monkeypatch.setattr(words, "ask_for_page", lambda scene, **_: (scene.folder / "gone/names.json").touch())
    assert "gone/names.json: No such file" in answer(like="7", name="mine")["why"]
