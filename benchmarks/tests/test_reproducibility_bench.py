"""Equal artifacts and documents have no difference; others have one with its size."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.reproducibility import __main__ as reproducibility
from benchmarks.reproducibility import chain
from benchmarks.reproducibility.chain import INPUTS, file_of
from benchmarks.reproducibility.comparing import differences
from benchmarks.reproducibility.limits import AVX2, LIMITS, choices
from egosplat.pipeline.stages import STAGES
from tests.support.scenes import put


def poses(path, shift=0.0, registered=(True, True)):
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 2.0 + shift
    return put(path.parent, "poses", {"camera_to_world": matrices, "registered": np.array(registered)})


def test_differences_of_artifacts_are_measured(tmp_path):
    one = poses(tmp_path / "a/poses.zarr")
    (found,) = differences(one, poses(tmp_path / "b/poses.zarr", shift=0.5))
    assert found.name == "camera_to_world" and found.share == 1 / 32
    assert found.largest == pytest.approx(0.25)
    (found,) = differences(one, poses(tmp_path / "c/poses.zarr", registered=(True, False)))
    assert (found.name, found.share, found.largest) == ("registered", 0.5, None)


def test_documents_are_compared_without_what_differs_each_time(tmp_path):
    document = {"provenance": {"created": "now"}, "scores": [{"psnr": 20.0}, {"level": "whole"}]}
    one, other = tmp_path / "a.json", tmp_path / "b.json"
    one.write_text(json.dumps(document))
    other.write_text(json.dumps(document | {"provenance": {"created": "later"}}))
    assert differences(one, other) == []
    other.write_text(json.dumps(document | {"scores": [{"psnr": 16.0}, {"level": "part"}]}))
    quality, level = differences(one, other)
    assert (quality.name, quality.largest) == ("scores[0].psnr", pytest.approx(0.2))
    assert (level.name, level.largest) == ("scores[1].level", None)


def test_every_limit_is_set_on_the_whole_chain(monkeypatch):
    """Each stage is there, and what is limited together holds each limit that is set alone."""
    assert set(INPUTS) <= set(STAGES) and file_of("synthetic") == "recording"
    alone = [limit for limit in LIMITS if len(limit.variables) == 1 and limit.name != "kernels generic"]
    assert AVX2.items() >= {item for limit in alone for item in limit.variables.items()}
    assert set(choices()) == {"kernels", "NumPy", "OpenBLAS", "OpenCV", "PyTorch", "threads"}


@pytest.mark.slow
def test_stages_run_again_give_the_same(tmp_path, monkeypatch):
    """The first two stages: the chain calls them as they are called today."""
    few = {name: INPUTS[name] for name in ("synthetic", "frames")}
    for module in (chain, reproducibility):
        monkeypatch.setattr(module, "INPUTS", few)
    film = {"size": 64, "fps": 2.0, "seconds": 2.0, "objects": 16}
    monkeypatch.setattr(chain, "SMALL", {"synthetic": film, "frames": {"resolution": 32}})
    for name in ("reference", "again"):
        words = ["--work", str(tmp_path), "--only", name]
        done = CliRunner().invoke(reproducibility.main, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
    (again,) = [limit for limit in LIMITS if limit.name == "again"]
    assert reproducibility.compared(tmp_path, again) == {"synthetic": [], "frames": []}
