"""The page of public benchmarks: printed numbers, and scores beside them."""

import hashlib
import shutil
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.common import ROOT
from benchmarks.public import __main__ as public
from benchmarks.public.__main__ import PRINTED, TABLES, deviations, main, own_row, printed_rows
from benchmarks.public.boxes import write_lerf
from egosplat.evaluation.options import recorded_options
from egosplat.pipeline.config import resolve, stage_values
from egosplat.pipeline.general_options import SHIPPED
from egosplat.pipeline.strict_yaml import read_yaml
from egosplat.pipeline.variants import read_scenes_with_presets, scene_config
from egosplat.query.grades import held_keys
from egosplat_rivals.scored_scenes import ScoredScene
from tests.support.hub import Hub


def scored(kind: str, scene: str, iou: float, **options: object) -> ScoredScene:
    """A scene by its benchmark's protocol but for ``options``; its accuracy is 0.5."""
    protocol = {section: dict(keys) for section, keys in SHIPPED["formats"][kind].items()}
    frames = protocol.pop("frames") | options
    made = {key: value for keys in protocol.values() for key, value in keys.items()}
    score = {"accuracy": 0.5, "accuracy_interval": None, "mean_iou": iou, "mean_iou_interval": None}
    document = {
        "scene": f"{kind}/{scene}",
        "origin": "real",
        "recording": {"kind": kind},
        "provenance": {"options": made},
        "artifacts": {"frames.zarr": {"options": frames}},
        "scores": {"all": score | {"count": 3, "categories": 2}},
    }
    return ScoredScene(Path(), kind, scene, "full", None, (), document)


def test_the_page_has_the_tables_as_they_are_printed():
    done = CliRunner().invoke(main, [])
    assert done.exit_code == 0, done.output
    page = (ROOT / "benchmarks/public/README.md").read_text(encoding="utf-8")
    assert done.output.strip() in page and len(done.output) > 1500


@pytest.mark.parametrize("table", TABLES)
def test_a_printed_mean_is_that_of_its_scenes(table):
    """But for LangSplatV2's accuracy and N2F2's mIoU, as the page says."""
    other = {("LangSplatV2", "accuracy"), ("N2F2", "mean_iou")}
    rows = pd.read_csv(PRINTED).query("table == @table")
    for method, found in rows.groupby("method"):
        scenes, mean = found[found["scene"] != "mean"], found[found["scene"] == "mean"]
        for column in ("accuracy", "mean_iou"):
            if len(scenes) and (method, column) not in other and scenes[column].notna().all():
                assert scenes[column].mean() == pytest.approx(mean[column].item(), abs=0.08), (method, column)
        assert {*found["scene"]} - {"mean"} <= {*TABLES[table][1]} and found["source"].nunique() == 1


def test_own_scores_stand_in_a_row_with_their_mean():
    names = TABLES["lerf"][1]
    row = own_row("lerf", [scored("lerf", name, 0.1 * index) for index, name in enumerate(names)])
    assert row[1:-1] == ["50.0 / 0.0", "50.0 / 10.0", "50.0 / 20.0", "50.0 / 30.0", "50.0 / 15.0"]
    assert len(row) == len(next(printed_rows("lerf")))
    assert own_row("3d_ovs", [scored("3d_ovs", "room", 0.5)])[1:-1] == ["", "", "", "50.0", "", ""]
    assert "yours, usual" in own_row("lerf", [scored("lerf", "ramen", 0.5)], ", usual")[0]


def test_lerf_ovs_is_fetched_with_settings_that_plan_its_scenes(tmp_path, monkeypatch):
    write_lerf(tmp_path / "made/lerf_ovs", "ramen")
    (tmp_path / "made/__MACOSX/lerf_ovs/label").mkdir(parents=True)
    content = Path(shutil.make_archive(str(tmp_path / "made"), "zip", tmp_path / "made")).read_bytes()
    known = public.LERF_OVS._replace(sha256=hashlib.sha256(content).hexdigest())
    monkeypatch.setattr(public, "LERF_OVS", known)
    with Hub(content, monkeypatch, tmp_path / "hub") as hub:
        done = CliRunner().invoke(main, ["--fetch", str(tmp_path / "data")], catch_exceptions=False)
        assert hub.requests == [known.address] and "/datasets/Qmh/lerf_ovs/resolve/dd69" in known.address
    presets, keys = ROOT / "config/presets", read_yaml(Path(done.stdout.strip()))
    scene = read_scenes_with_presets(resolve(keys, presets), presets)["lerf", "ramen"]
    assert scene.recording.is_dir() and [*scene.config["presence"]["negatives"]] == ["box", "mug", "sign"]
    # A fit holds for scenes of users, whose queries have no protocol.
    for variant, own in {"asked": {"preset": "paper"}, "usual_asked": {"models": {"set": "light"}}}.items():
        configs = scene_config(scene, variant), resolve(own, presets)
        assert len({(one["models"]["set"], one["transient"]["lr"]) for one in configs}) == 1
        fitted, asked = (recorded_options(stage_values("metrics", one)) for one in configs)
        assert held_keys(fitted) == held_keys(asked) and fitted.readout == asked.readout


def test_a_key_that_differs_from_the_protocol_is_named():
    assert [*deviations(scored("lerf", "ramen", 0.5))] == []
    (line,) = deviations(scored("3d_ovs", "bed", 0.5, resolution=512))
    assert "3d_ovs/bed" in line and "frames.resolution is 512" in line and "1008" in line
