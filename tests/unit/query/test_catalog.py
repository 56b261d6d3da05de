"""What is in a scene: each thing once, under its best name, in the terminal and in files."""

import json
import shutil
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import trimesh

import egosplat
from egosplat.query.answers import Answer, Thing
from egosplat.query.catalog import merge
from tests.support.page_scene import PUT_DOWN, put_histories


def claim(name: str, first: int, end: int, rating: float) -> Answer:
    grade = "found" if rating > 0.6 else "best guess"
    thing = Thing(rating, "whole", np.zeros(3), np.ones(3), 0, np.arange(first, end))
    return Answer(name, grade, rating, things=(thing,))


@pytest.mark.parametrize(
    "claims, told",
    [
        ([("table", 0, 9, 0.9), ("coffee table", 0, 8, 0.7), ("rug", 0, 7, 0.8)], ["coffee table/table/rug"]),
        ([("table", 0, 90, 0.9), ("coffee table", 0, 80, 0.5)], ["table/coffee table"]),
        ([("couch", 0, 90, 0.7), ("cushion", 0, 20, 0.9)], ["couch"]),
        ([("couch", 0, 90, 0.9), ("cushion", 0, 20, 0.7)], ["couch"]),
        ([("wall", 0, 90, 0.9), ("painting", 0, 20, 0.7), ("wall", 30, 40, 0.6)], ["wall", "painting"]),
        ([("fridge", 100, 120, 0.9), ("fridge", 130, 140, 0.7), ("book", 200, 220, 0.5)], ["fridge", "book"]),
    ],
)
def test_a_thing_is_told_once_under_its_best_name(claims, told):
    surface = SimpleNamespace(visible=len, instance_of=lambda rows: 7 if 100 <= rows[0] < 200 else -1)
    items = merge(surface, [claim(*one) for one in claims])
    assert ["/".join([one.phrase, *one.also]) for one in items] == told


def test_the_table_and_its_files_tell_of_each_thing(page_scene, tmp_path, run_command):
    folder = tmp_path / "results/scene1"
    put_histories(shutil.copytree(page_scene, folder))
    cup, wall, couch, carried = answers = egosplat.catalog(egosplat.open_scene(folder, device="cpu"))
    assert [one.phrase for one in answers] == ["cup", "wall", "couch", "cup"]
    assert couch.grade == "found" and couch.things[0].center[0] < -0.3 and cup.things[0].center[0] > 0.3
    assert not carried.things and carried.history[0].end.tolist() == [*PUT_DOWN]
    call = partial(run_command, "catalog", folder)
    run_command("catalog", page_scene, "--set", "min_score=1", "--output", tmp_path / "none.csv")
    assert pd.read_csv(tmp_path / "none.csv").empty
    status, table, _ = call("--output", tmp_path / "x.csv")
    told = [line.replace(" or ", "  ").split("  ")[0] for line in table.splitlines()[2:6]]
    rows = pd.read_csv(tmp_path / "x.csv")
    assert status == 0 and [*rows.name] == told == [one.phrase for one in answers]
    centers = [answer.things[0].center for answer in (cup, wall, couch)]
    np.testing.assert_allclose(rows[["x", "y", "z"]].to_numpy()[:3], centers, atol=1e-4)
    assert rows.carried[3] == carried.history[0].told and rows.size_x.isna().tolist() == [False] * 3 + [True]
    assert call("--output", tmp_path / "x.json")[0] == call("--output", tmp_path / "x")[0] == 0
    assert (document := json.loads((tmp_path / "x.json").read_text())) == json.loads(call("--json")[1])
    names = [*pd.read_csv(tmp_path / "x/things.csv").name]
    assert [one["phrase"] for one in document] == [*rows.name] == names
    clouds = sorted(len(trimesh.load(path).vertices) for path in (tmp_path / "x").glob("*.ply"))
    assert clouds == sorted(len(answer.things[0].members) for answer in (cup, couch, wall))
    for name in ("x.txt", "x.csv", "x"):
        status, _, said = call("--output", tmp_path / name)
        assert status == 2 and f"{tmp_path / name}: " in said and "--output" in said and said.count("\n") == 1
