"""Real recordings through the whole workflow, where they are."""

import json
from pathlib import Path

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, FRAMES, POSES, SPLATS

pytestmark = pytest.mark.slow

PICTURES = ("results/mine/scene/contact_sheet.png", "results/mine/scene/splats.png")

BRIEFLY = "splats.masking=none splats.iterations=30 splats.max_points=2000 splats.max_gaussians=2000"
"""Enough to see that training runs, not to see a scene."""


@pytest.fixture
def workflow(one_scene):
    """Results of the whole workflow on one recording; a second run must have nothing to do."""

    def run(format: str, recording: Path, options: str) -> Path:
        workdir = one_scene(format, recording, f"{options} {BRIEFLY}")
        workdir.run(*PICTURES)
        assert workdir.stale(*PICTURES) == set()
        return workdir.folder / "results/mine/scene"

    return run


def test_a_real_adt_recording(workflow, real_data):
    options = "frames.resolution=352 frames.evaluation_frames=1 poses.trajectory=ground_truth"
    results = workflow("adt", real_data("adt_sample"), options)
    frames = open_artifact(results / "frames.zarr", FRAMES)
    assert frames.shape("rgb") == (3, 352, 352, 3) and frames.origin == "real"
    # The lens circle: nearly all of the rectified square's inscribed circle, nothing of its corners.
    valid = frames.read("valid")
    assert 0.70 < valid.mean() < 0.80 and not valid[[0, 0, -1, -1], [0, -1, 0, -1]].any() and valid[176, 176]
    annotations = open_artifact(results / "annotations.zarr", ANNOTATIONS)
    instances = annotations.facts["instances"]
    kinds = [instance["motion_type"] for instance in instances]
    assert (len(instances), kinds.count("static"), kinds.count("dynamic")) == (350, 304, 46)
    assert len({instance["category"] for instance in instances}) == 106
    assert annotations.read("annotated").all() and len(np.unique(annotations.row("instance_map", 0))) > 60
    assert open_artifact(results / "poses.zarr", POSES).read("registered").all()
    splats = open_artifact(results / "splats.zarr", SPLATS)
    assert splats.origin == "real" and np.isfinite(splats.read("held_out/psnr")).tolist() == [True]


def test_real_photographs(workflow, real_data):
    results = workflow(
        "plain", real_data("tum_fr3_office"), "frames.resolution=400 frames.evaluation_frames=3"
    )
    poses = open_artifact(results / "poses.zarr", POSES)
    notes = poses.facts["notes"]
    assert poses.read("registered").sum() == 17
    assert notes["reprojection_error_px"] < 1.0, json.dumps(notes)
    assert open_artifact(results / "splats.zarr", SPLATS).read("held_out/psnr").min() > 8.0
