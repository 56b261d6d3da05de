"""The library: a finished scene as one object, and the examples of its documentation."""

import doctest
import shutil
import subprocess
import sys

import numpy as np
import pytest

import egosplat
from egosplat.artifacts import reader
from egosplat.errors import UserError
from egosplat.query import finished_scene, text
from egosplat.query.scene import QueryScene
from tests.support import ROOT, page_scene

SHEET = dict.fromkeys(("frames", "annotations", "poses", "output"), "f")


def test_the_page_of_the_library_runs_as_it_is(work):
    page = str(ROOT / "docs/python.md")
    how = {"module_relative": False, "optionflags": doctest.NORMALIZE_WHITESPACE}
    failed, tried = doctest.testfile(page, **how)
    assert tried > 20 and not failed
    assert (work / "couch.ply").is_file() and (work / "splats.zarr").is_dir()


def test_opening_reads_no_array_and_writes_nothing(work, monkeypatch):
    before = sorted(work.rglob("*"))
    with monkeypatch.context() as patch:
        patch.setattr("egosplat.artifacts.reader.Artifact.read", None)
        patch.chdir("/")
        scene = egosplat.open_scene(work / "results/adt/scene1")
        assert scene.levels == ["part", "whole"]
    (couch,) = scene.ask("couch")
    assert couch.things and len(repr(couch)) < 800 and sorted(work.rglob("*")) == before


def test_a_scene_is_read_once_and_a_changed_byte_of_what_no_query_reads_is_named(work, monkeypatch):
    scene, counted = egosplat.open_scene("results/adt/scene1"), []
    with monkeypatch.context() as patch:
        checked = reader.Artifact._checked

        def count(self, *given):
            counted.append((self.schema.name, given[1]))
            return checked(self, *given)

        patch.setattr(reader.Artifact, "_checked", count)
        scene.ask("couch")
    assert ("language", "code") in counted and len(counted) == len(set(counted))
    mine = work / "damaged"
    shutil.copytree(work / "results/adt/scene1", mine)
    with (mine / "splats.zarr/curve/loss/zarr.json").open("a") as layout:
        layout.write(" ")
    with pytest.raises(UserError, match="splats.zarr: .*digest"):
        egosplat.open_scene(mine).ask("couch")
    shutil.rmtree(mine)


def test_a_variant_has_the_answers_of_what_it_shares(work):
    mine, language = work / "results/adt/scene1/variants/mine", work / "results/adt/scene1/language.zarr"
    mine.mkdir(parents=True, exist_ok=True)
    language.rename(mine / "language.zarr")
    try:
        [couch] = egosplat.open_scene(mine).ask("couch")
    finally:
        (mine / "language.zarr").rename(language)
    assert couch.things[0].frame == 0


@pytest.mark.parametrize(
    "call, said",
    [
        (lambda scene: scene.ask("cup", frame=3), "frame 3"),
        (lambda scene: scene.ask("cup", frame=1, pose=np.eye(4)), "frame and pose"),
        (lambda scene: scene.ask("cup", pose=np.zeros((4, 4))), "pose"),
        (lambda scene: scene.ask("cup", pose=[[1], [2, 3]]), "pose: is not 4x4 numbers"),
        (lambda scene: scene.ask("cup", min_scor=0.1), "min_score"),
        (lambda scene: scene.render(), "frame or a pose"),
        (lambda scene: scene.artifact("masks"), "masks.zarr"),
        (lambda scene: scene.artifact("poses").read("ups"), "no array 'ups' in camera_to_world"),
        (lambda scene: egosplat.export_scene(scene, "x.txt"), "x.txt"),
        (lambda scene: egosplat.export_scene("results/adt/scene1", format="splat"), "'splat': is unknown"),
        (lambda scene: egosplat.open_scene("results/adt/scene9"), "results/adt/scene9/l"),
        (lambda scene: egosplat.run_stage("splat"), "splats"),
        (lambda scene: egosplat.run_stage("splats", frames="f"), "output, poses"),
        (lambda scene: egosplat.run_stage("contact_sheet", **SHEET | {"poses": None}, x=1), "x is no input"),
    ],
)
def test_a_mistake_is_named(work, call, said):
    with pytest.raises(egosplat.UserError) as error:
        call(egosplat.open_scene("results/adt/scene1"))
    assert said in str(error.value) and str(error.value).count("\n") < 2


@pytest.mark.parametrize("levels", [["part", "whole"], ["granular"]])
def test_levels_of_codes_may_be_fewer_than_those_of_instances(tmp_path, monkeypatch, levels):
    """There may be no subpart, and some methods have one code for all levels."""
    write = page_scene.put

    def put(folder, name, arrays, facts=None, **more):
        if name == "instances":
            arrays |= {key: np.insert(arrays[key], 0, -1, axis=1) for key in ("gaussians/instance", "labels")}
            arrays["instances/level"] += np.int8(1)
            facts |= {"levels": ["subpart", *facts["levels"]]}
        elif name == "language":
            arrays, facts = {key: one[:, -len(levels) :] for key, one in arrays.items()}, {"levels": levels}
        return write(folder, name, arrays, facts, **more)

    monkeypatch.setattr(page_scene, "put", put)
    page_scene.put_page_scene(tmp_path)
    scene = egosplat.open_scene(tmp_path, device="cpu")
    assert [scene.ask("couch", **where)[0].grade for where in ({}, {"frame": 1})] == ["found"] * 2
    _, arrays = page_scene.contents_of(page_scene.write_page(tmp_path))
    assert scene.instances.shape == arrays["instance"].shape == (len(levels), 700)
    assert (
        np.unique(scene.instances[-1]).tolist()
        == [3, 4, 5]
        == (np.unique(arrays["instance"][-1]) - 1).tolist()
    )
    asked, relevancy = [], QueryScene.relevancy
    monkeypatch.setattr(QueryScene, "relevancy", lambda *it: asked.append(it[1].phrases) or relevancy(*it))
    monkeypatch.setattr(finished_scene, "length_unit", lambda _: "scene units")
    monkeypatch.setattr(text, "AT_ONCE", 1)
    assert egosplat.open_scene(tmp_path, device="cpu").ruler is None and {*map(len, asked)} == {1}


def test_public_names_are_there_and_come_on_demand():
    assert all(getattr(egosplat, name) for name in egosplat.__all__)
    assert {*egosplat.__all__} <= {*dir(egosplat)}
    with pytest.raises(AttributeError):
        _ = egosplat.nothing
    heavy = "import egosplat, sys; sys.exit(bool({'numpy', 'torch', 'pydantic', 'zarr'} & {*sys.modules}))"
    assert subprocess.run([sys.executable, "-c", heavy], check=False).returncode == 0
