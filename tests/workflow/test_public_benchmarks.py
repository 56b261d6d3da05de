"""A scene of each public benchmark goes from its files to its scores, by the benchmark's own protocol."""

import pytest

from benchmarks.public.boxes import write_3d_ovs, write_lerf
from egosplat import files
from egosplat.artifacts import provenance
from egosplat.evaluation import stage as metrics
from egosplat.frames import annotations_stage
from egosplat.pipeline.config import of_format, resolve, stage_values
from egosplat.pipeline.validation import read_document
from tests.support.chain import run_all
from tests.unit.test_paper_preset import PRESETS

WRITERS = {"lerf": write_lerf, "3d_ovs": write_3d_ovs}


@pytest.mark.slow
@pytest.mark.parametrize("format", WRITERS)
def test_from_files_to_scores(tmp_path, monkeypatch, format):
    monkeypatch.setattr(provenance, "code_of", lambda *_: "0")
    monkeypatch.setattr(files, "_sync_one", lambda path: None)
    config = of_format(resolve({"splats": {"masking": "refined"}}, PRESETS), format)
    recording = WRITERS[format](tmp_path / "data")
    run_all(tmp_path, recording, format=format, config=config)
    names = ("frames", "annotations", "poses", "splats", "language", "features")
    paths = {f"{name}_path": tmp_path / f"{name}.zarr" for name in names}
    given = recording, paths["frames_path"], paths["annotations_path"]
    annotations_stage.run(*given, annotations_stage.AnnotationsOptions())
    options, output = metrics.MetricsOptions(**stage_values("metrics", config)), tmp_path / "metrics.json"
    metrics.run(output=output, options=options, title=f"{format}/boxes", **paths)
    found = read_document(output, "metrics")
    # The models are trained on the evaluation frames, too.
    assert found["counts"]["training_frames"] == found["counts"]["frames"] == 8
    assert {frame["queries"] for frame in found["frames"]} == {3} and len(found["frames"]) == 2
    assert ("pixel_accuracy" in found) == (format == "3d_ovs") and found["recording"]["kind"] == format
    if format == "3d_ovs":
        masks = {frame["frame"]: 0 for frame in found["frames"]}
        for query in found["queries"]:
            masks[query["frame"]] += query["mask_pixels"]
        # Each pixel is of one class at most.
        assert 0 < max(masks.values()) <= 72 * 96 and 0 <= found["pixel_accuracy"] <= 1
