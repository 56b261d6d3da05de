"""What a configuration needs is listed and fetched; a run chooses for who chooses nothing."""

import hashlib
import os
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from egosplat.cli import cli
from egosplat.errors import UserError
from egosplat.models import needed
from egosplat.pipeline import model_sets
from egosplat.run import command
from tests.support.hub import Hub
from tests.unit.run.conftest import write_pictures

CONTENT = b"weights " * 100_000
SHA256 = hashlib.sha256(CONTENT).hexdigest()
TABLE = Path("config/scenes.local.tsv")
LIGHT = {"sam2.1_hiera_tiny.pt", "ViT-B-32-256.datacomp_s34b_b86k.bin"}
FILES = "sam2.1_hiera_base_plus.pt", "ViT-B-16.laion2b_s34b_b88k.bin"
FILES += ("mobilenetv3_small_050.lamb_in1k.safetensors",)


@pytest.fixture
def server(tmp_path, monkeypatch):
    """A hub that has every file of the catalogue, with one content; of some, the last too, no digest is published."""
    entries = [one._replace(sha256=one.sha256 and SHA256) for one in model_sets.CATALOGUE]
    entries[-1] = entries[-1]._replace(sha256=None)
    monkeypatch.setattr(model_sets, "CATALOGUE", tuple(entries))
    monkeypatch.setattr(needed, "CATALOGUE", tuple(entries))
    with Hub(CONTENT, monkeypatch, tmp_path / "hub") as running:
        yield running


@pytest.fixture
def make(folder, server, monkeypatch):
    """Make a scene of photographs, in which Snakemake does nothing, and get its set of models, which its row keeps."""
    write_pictures(folder / "photos")
    monkeypatch.setattr(command, "run_snakemake", lambda words: 0)

    def made(*options: str) -> str:
        found = command.make_scene(folder / "photos", options=options).config["models"]["set"]
        assert f"models.set={found}" in TABLE.read_text()
        return found

    return made


def address(file: str) -> str:
    return model_sets.named_model(Path(file).name).address


def egosplat(*words: str) -> str:
    """Call the command line."""
    return CliRunner().invoke(cli, ["models", *words], catch_exceptions=False, standalone_mode=False).output


def test_the_small_models_are_there(folder, server):
    listed = egosplat()
    assert listed.count("bundled with egosplat") == 3 and "Nothing is missing." in listed
    assert "transient.encoder_weights" not in listed
    assert "bundled" in egosplat("download") and server.requests == []


def test_missing_models_come_with_place_license_size_and_digest(folder, server):
    listed = egosplat("--config", "models.set=published", "--config", "models.cache=cache")
    for key in model_sets.LIBRARIES:
        assert f"{key}: " in listed
    for file in FILES:
        assert f"cache/{file}: missing" in listed and address(file) in listed
    assert "Apache-2.0" in listed and "MIT" in listed and "323.6 MB" in listed and SHA256 in listed
    assert "3 of 3 files" in listed and "929 MB" in listed
    assert listed.endswith("models download --config models.set=published --config models.cache=cache\n")
    assert server.requests == [] and not (folder / "cache").exists()


def test_a_download_fetches_what_is_missing_and_verifies_the_rest(folder, server):
    (folder / "cache").mkdir()
    (folder / "cache" / FILES[0]).write_bytes(CONTENT)
    options = ("--config", "models={set: published, cache: cache}")
    for words in (("download", *options), (*options, "download")):
        fetched = egosplat(*words)
        assert f"{FILES[0]}: there, SHA-256 verified" in fetched
    assert server.requests == [address(file) for file in FILES[1:]]
    for file in FILES:
        assert (folder / "cache" / file).read_bytes() == CONTENT
    assert sorted(os.listdir(folder / "cache")) == sorted(FILES)
    assert "Nothing is missing." in egosplat(*options) and "there, SHA-256 verified" in egosplat(*options)
    (folder / "cache" / FILES[0]).write_bytes(CONTENT + b"!")
    assert "DAMAGED" in egosplat(*options)


def test_a_file_in_the_users_own_cache_is_not_fetched_again(folder, server):
    told = egosplat("download", "mobilenetv3_small_050")
    assert "none is published" in told and SHA256 in told
    assert "/resolve/f58e7345afe2832abd6f81cc60f67cd1ddf7ce00/" in server.requests[0]
    (folder / "checkpoints" / FILES[2]).unlink()
    assert "Nothing is missing" in egosplat("download", "mobilenetv3_small_050") and len(server.requests) == 1


def test_a_file_with_another_digest_is_not_kept(folder, server):
    """Of the second none is published; the hub tells it as the tag of the file."""
    tag = {"ETag": f'"{"0" * 64}"'}
    for name, content, headers in (("ViT-B-16", b"another", {}), ("mobilenetv3_small_050", CONTENT, tag)):
        server.content, server.headers = content, headers
        with pytest.raises(UserError, match="has SHA-256 .*published is "):
            egosplat("download", name)
        assert not (folder / "checkpoints").exists()
    server.content, server.headers = CONTENT, {}
    assert "SHA-256 verified" in egosplat("download", "ViT-B-16")


@pytest.mark.parametrize(
    ("status", "headers", "environment", "told"),
    [
        (404, {}, {}, "404"),
        (200, {"Content-Length": "abc"}, {}, "Content-Length"),
        (302, {"Location": "ftp://somewhere/else"}, {}, "ftp://"),
        (200, {}, {"http_proxy": "http://127.0.0.1:port"}, "http_proxy"),
        (200, {}, {"http_proxy": "http://127.0.0.1:1"}, "http_proxy"),
        (200, {}, {"HF_ENDPOINT": "http://me:secret@nowhere:port"}, "HF_ENDPOINT"),
    ],
)
def test_what_goes_wrong_is_told_with_the_address_and_the_place(
    folder, server, monkeypatch, status, headers, environment, told
):
    import huggingface_hub

    server.status, server.headers = status, headers
    for name, value in ({"no_proxy": "", "NO_PROXY": ""} | environment).items():
        monkeypatch.setenv(name, value)
    # The library reads proxies when it first connects.
    huggingface_hub.close_session()
    with pytest.raises(UserError) as caught:
        egosplat("download", "ViT-B-16")
    huggingface_hub.close_session()
    first, second = str(caught.value).splitlines()
    assert "secret" not in first + second
    assert told in first and f"{address(FILES[1])} -> checkpoints/{FILES[1]}" in second
    assert not (folder / "checkpoints").exists()


def test_a_wrong_file_of_that_name_is_not_replaced(folder, server):
    path = folder / "checkpoints" / FILES[1]
    path.parent.mkdir()
    path.write_bytes(b"mine")
    with pytest.raises(UserError, match=f"(?s)has SHA-256 .*published is {SHA256}.*Remove it"):
        egosplat("download", "ViT-B-16")
    assert path.read_bytes() == b"mine" and server.requests == []


def test_offline_the_addresses_are_listed(folder, server):
    server.stop()
    with pytest.raises(UserError) as caught:
        egosplat("download", "--config", "models.set=published")
    first, second = str(caught.value).splitlines()
    assert address(FILES[0]) in first
    assert all(f"{address(file)} -> checkpoints/{file}" in second for file in FILES)


def test_models_of_the_catalogue_are_fetched_by_name(folder, server):
    told = egosplat("download", "sam2.1_hiera_l", "ViT-B-16-quickgelu")
    assert "sam2.1_hiera_large.pt: there, SHA-256 verified" in told
    assert server.requests == [address("sam2.1_hiera_large.pt"), address("ViT-B-16-quickgelu.dfn2b.bin")]
    with pytest.raises(UserError, match="sam2.1_hiera_x: is not in the catalogue.*sam2.1_hiera_t"):
        egosplat("download", "sam2.1_hiera_x")
    listed = egosplat("--all")
    assert all(one.file in listed for one in model_sets.CATALOGUE)
    assert "download sam2.1_hiera_t sam2.1_hiera_s sam2.1_hiera_b+ ViT-B-32-256 ViT-B-16 ViT-L-14" in listed


def test_files_of_the_user_are_listed_and_not_fetched(folder, server):
    options = ("--config", "models={sam2_checkpoint: mine.pt, set: published}")
    listed = egosplat(*options)
    assert "models.sam2_checkpoint: your own file" in listed and "mine.pt: missing" in listed
    with pytest.raises(UserError, match="models.sam2_checkpoint: there is no file mine.pt"):
        egosplat("download", *options)
    (folder / "mine.pt").write_bytes(b"mine")
    assert "mine.pt: there" in egosplat("download", *options)


def test_the_table_of_scenes_counts(folder, server):
    (folder / "config").mkdir()
    (folder / "config/config.yaml").write_text("segments: {segmenter: classical}")
    assert "sam2" not in egosplat()
    rows = "dataset\tscene\tformat\trecording\toptions\nmine\ta\tplain\ta.mp4\tmodels.set=published\n"
    (folder / "config/scenes.tsv").write_text(rows)
    listed = egosplat()
    assert FILES[1] in listed and "bundled with egosplat" in listed and FILES[0] not in listed


def test_a_download_goes_on_where_it_broke_off(folder, server, monkeypatch):
    """Also from another folder; what came before stays in the user's own cache."""
    monkeypatch.setattr("huggingface_hub.constants.DOWNLOAD_CHUNK_SIZE", 1000)
    server.breaks = 300_000
    with pytest.raises(UserError, match="503.*\n.*same command goes on"):
        egosplat("download", "ViT-B-16")
    (folder / "other").mkdir()
    monkeypatch.chdir(folder / "other")
    server.breaks, server.status = None, 200
    assert "there, SHA-256 verified" in egosplat("download", "ViT-B-16")
    assert len(server.begins) == 2 and 0 < server.begins[1] <= 300_000


def test_a_run_fetches_fast_published_models_once_and_tells_size_and_digest(folder, server, make, caplog):
    assert make() == "light" and {path.name for path in Path("checkpoints").iterdir()} == LIGHT
    assert "761 MB are fetched once" in caplog.text and "models light" in caplog.text
    assert "published SHA-256: none" in caplog.text and f"published SHA-256: {SHA256}" in caplog.text
    assert server.asked == len(server.requests) == len(LIGHT)
    server.stop()  # what the user's own cache has needs no network
    shutil.rmtree("checkpoints")
    assert "Nothing is missing" in egosplat("download", "--config", "models.set=light") and make() == "light"


def test_without_a_network_the_bundled_models_serve_and_the_scene_keeps_them(folder, server, make, caplog):
    """One line says so and how to get the others. A network later switches nothing by itself, in scenes of older versions neither."""
    server.stop()
    assert make() == "photos" and not Path("checkpoints").exists()
    (line,) = [one for one in caplog.messages if "bundled" in one]
    assert server.address in line and "--set models.set=light" in line and "\n" not in line
    with Hub(CONTENT, pytest.MonkeyPatch(), folder / "later") as later:
        assert make() == "photos"
        TABLE.write_text(TABLE.read_text().replace("models.set=photos", ""))
        assert make() == "photos" and later.requests == []
        assert make("models.set=light") == "light" == make() == make("models.set=auto")


def test_the_sign_in_page_of_a_network_is_no_hub(server, make, caplog):
    server.headers = {"ETag": '"page"', "X-Repo-Commit": ""}
    assert make() == "photos" and "sign-in page" in caplog.text and not server.requests
    with pytest.raises(UserError, match="(?s)is no Hugging Face hub, .*goes on"):
        make("models.set=light")


@pytest.mark.parametrize("status", [404, 503])
def test_a_hub_that_answers_wrongly_is_no_reason_for_other_models(server, make, status):
    server.status = status
    with pytest.raises(UserError, match=rf"(?s){status}.*goes on.*models.set=photos"):
        make()
    server.stop()
    with pytest.raises(UserError, match="cannot be fetched"):
        make()
    assert make("models.set=photos") == "photos" == make()


def test_who_chooses_gets_no_other_models(folder, server, make):
    assert make("models.set=small") == "small"
    TABLE.unlink()
    Path("config/config.yaml").write_text("formats: {plain: {models: {set: photos}}}")
    assert command.make_scene(folder / "photos").config["models"]["set"] == "photos" and server.requests == []
