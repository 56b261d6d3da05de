"""A recording of pictures of one pixel goes through every stage, and can be asked."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat import files, open_scene
from egosplat.artifacts import provenance
from egosplat.artifacts.check import check_tree
from egosplat.features import options as of_features
from egosplat.features import stage as features
from egosplat.features import view_features_stage as view_features
from egosplat.frames import stage as frames
from egosplat.frames.options import FramesOptions
from egosplat.instances import stage as instances
from egosplat.instances.options import InstancesOptions
from egosplat.language import stage as language
from egosplat.language.options import LanguageOptions
from egosplat.pipeline.config import defaults, stage_values
from egosplat.poses import stage as poses
from egosplat.poses.options import PosesOptions
from egosplat.segments import stage as segments
from egosplat.segments.options import SegmentsOptions
from egosplat.splats import stage as splats
from egosplat.splats.options import SplatsOptions
from egosplat.survey import stage as survey
from egosplat.survey.options import SurveyOptions
from egosplat.transient import masks_stage as masks
from egosplat.transient import options as of_transient
from egosplat.transient import stage as transient

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


def run_all(folder: Path, unit: float) -> None:
    """Run the stages of a scene, for few iterations."""

    def of(kind, section, **changes):
        short = {key: 3 for key in ("iterations",) if key in kind.model_fields}
        near = {"near_plane": 0.1 * unit} if "near_plane" in kind.model_fields else {}
        return kind(**stage_values(section, defaults()) | short | near | changes)

    def at(*names):
        return [folder / f"{name}.zarr" for name in names]

    recording, seen = record(folder / "recording", unit), {"survey_path": folder / "survey.json"}
    frames.run(recording, *at("frames"), of(FramesOptions, "frames"), format="plain")
    poses.run(recording, *at("frames", "poses"), of(PosesOptions, "poses"))
    survey.run(*at("frames", "poses"), folder / "survey.json", of(SurveyOptions, "survey"))
    network = of(of_transient.TransientOptions, "transient", encoder_weights=None)
    transient.run(*at("frames", "poses", "transient"), network, **seen)
    segments.run(*at("frames", "segments"), of(SegmentsOptions, "segments", segmenter="classical"), **seen)
    found = at("frames", "poses", "segments", "instances")
    instances.run(*found, of(InstancesOptions, "instances"), **seen)
    view_features.run(
        *at("frames", "instances", "view_features"), of(of_features.ViewFeaturesOptions, "view_features")
    )
    features.run(*at("view_features", "features"), of(of_features.FeaturesOptions, "features"))
    masks.run(*at("frames", "transient", "instances", "masks"), of(of_transient.MasksOptions, "masks"))
    masked = seen | {"masks_path": folder / "masks.zarr"}
    splats.run(*at("frames", "poses", "splats"), of(SplatsOptions, "splats", masking="refined"), **masked)
    more = {f"{name}_path": folder / f"{name}.zarr" for name in ("instances", "features")}
    language.run(
        *at("frames", "poses", "splats", "language"), of(LanguageOptions, "language"), **masked, **more
    )


@pytest.mark.numerics(
    "pictures of 1x1 px, with poses in units of 1e6 m, through every stage, and a query of the scene",
    outside="sound artifacts; an answer, or none",
)
def test_pictures_of_one_pixel(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "code_of", lambda *_: "0")
    monkeypatch.setattr(files, "_sync_one", lambda path: None)
    run_all(tmp_path, 1e-6)
    reports = check_tree(tmp_path, lambda line: None)
    assert len(reports) == 11 and all(report.sound for report in reports)
    assert open_scene(tmp_path).ask("couch")
