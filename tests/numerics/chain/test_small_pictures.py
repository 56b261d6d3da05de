"""A recording of pictures of one pixel goes through every stage, and can be asked."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat import files, open_scene
from egosplat.artifacts import provenance
from egosplat.artifacts.lineage import check_tree
from tests.support.chain import run_all

FRAMES = 8


def record(folder: Path, unit: float) -> Path:
    """Pictures of 1x1 px of a camera that moves sideways, with their poses in units of ``1 / unit`` m."""
    folder.mkdir()
    entries = []
    for frame, x in enumerate(np.linspace(-0.4, 0.4, FRAMES)):
        Image.new("RGB", (1, 1), (220, 30, 30)).save(folder / f"{frame}.png")
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[0, 3] = x * unit
        entries.append({"file_path": f"{frame}.png", "transform_matrix": pose.tolist()})
    camera = {"w": 1, "h": 1, "fl_x": 1.0, "fl_y": 1.0, "cx": 0.5, "cy": 0.5}
    (folder / "transforms.json").write_text(json.dumps(camera | {"frames": entries}))
    return folder


@pytest.mark.numerics(
    "pictures of 1x1 px, poses in units of 1e6 m: every stage and a query",
    outside="valid artifacts; an answer, or none",
)
def test_pictures_of_one_pixel(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "code_of", lambda *_: "0")
    monkeypatch.setattr(files, "_sync_one", lambda path: None)
    run_all(tmp_path, record(tmp_path / "recording", 1e-6), 1e-6)
    reports = check_tree(tmp_path, lambda line: None)
    assert len(reports) == 11 and not any(reports.values())
    assert open_scene(tmp_path).ask("couch")
