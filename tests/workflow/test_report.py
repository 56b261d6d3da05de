"""Snakemake's report shows the results that it is asked for."""

import base64
import json
import re
import zipfile
from pathlib import Path

import pytest

RESULTS = re.compile(r"var results = (\{.*?\});?\s*</script>", re.DOTALL)
DESCRIPTION = re.compile(r"var workflow_desc = (\".*\");?\n")


def report(workdir, output: Path, *targets: str) -> str:
    done = workdir.snakemake("--report", output, *targets)
    assert done.returncode == 0, done.stdout + done.stderr
    if output.suffix == ".zip":
        with zipfile.ZipFile(output) as file:
            return file.read(f"{output.stem}/report.html").decode()
    return output.read_text(encoding="utf-8")


def rows(page: str) -> dict[str, dict]:
    return json.loads(RESULTS.search(page)[1])


@pytest.fixture(scope="module")
def page(finished, tmp_path_factory) -> str:
    return report(finished, tmp_path_factory.mktemp("report") / "report.html", "--", *finished.MAIN)


def test_every_result_of_the_finished_scene_has_a_row_of_its_own(finished, page):
    found = rows(page)
    assert set(found) == set(finished.MAIN)
    labels = [tuple(row["labels"].items()) for row in found.values()]
    assert len(set(labels)) == len(finished.MAIN)
    assert found["results/adt/scene1/queries.png"]["labels"] == {
        "dataset": "adt",
        "scene": "scene1",
        "variant": "none",
        "page": "queries",
    }
    captions = [row["caption"] for row in found.values()]
    assert len(set(captions)) == len(captions) and all("adt/scene1" in caption for caption in captions)
    scores = found["results/adt/scene1/metrics.json"]
    assert scores["mime_type"] == "application/json" and "mIoU" in scores["caption"]
    content = base64.b64decode(scores["data_uri"].partition("base64,")[2])
    assert content == (finished.folder / "results/adt/scene1/metrics.json").read_bytes()


def test_the_story_has_every_picture_and_the_scene_and_is_in_the_report(workdir, tmp_path):
    workdir.run("results/adt/scene1/story.html")
    story = (workdir.folder / "results/adt/scene1/story.html").read_text()
    assert story.count("data:image/webp") == len(workdir.PAGES) and "<iframe" in story
    assert "there is no survey" in story and "instances move" in story and "queries point at" in story
    page = report(workdir, tmp_path / "report.html", "--", "results/adt/scene1/story.html")
    assert "results/adt/scene1/story.html" in rows(page) and '"Overview"' in page


def test_report_text_covers_every_step_without_markup(page):
    text = json.loads(DESCRIPTION.search(page)[1])
    steps = re.findall(r"<li><p><strong>([^<]+)</strong>|<li><strong>([^<]+)</strong>", text)
    assert [one or other for one, other in steps] == [
        *("Frames", "Survey", "Instances", "Features", "Transient masks", "Gaussians", "Language", "Queries")
    ]
    assert "system-message" not in text and "{{" not in text


def test_report_works_with_targets_and_as_zip(finished, tmp_path):
    targets = ("results/adt/scene1/metrics.json", "results/adt/scene1/queries.png")
    page = report(finished, tmp_path / "report.zip", "--", *targets)
    assert set(rows(page)) == set(targets)
    with zipfile.ZipFile(tmp_path / "report.zip") as file:
        assert {Path(name).name for name in file.namelist()} >= {"metrics.json", "queries.png"}
