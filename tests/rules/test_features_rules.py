"""The rules view_features and features run on existing frames and segments, with the user's own OpenCLIP model."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from safetensors.torch import load_file, save_file

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from tests.support.scenes import put_scene
from tests.support.tiny_clip import CHECKPOINT, write_tiny_clip
from tests.support.warm import run_snakemake

ROOT = Path(__file__).resolve().parents[2]
SCENE = "results/mine/scene"
BOTH = {"view_features", "features"}
FILES = ("common/start", "common/scenes", "common/dag", "rules/features")
SNAKEFILE = "# Two rules of egosplat.\n" + "".join(f'include: "{name}.smk"\n' for name in FILES)
UNSURVEYED = (
    "survey.min_view_change_deg=0 splats.masking=none segments.track_moving=never "
    "camera.refine_poses=off camera.compensate_exposure=off"
)
"""Options of a scene without a survey, which would need poses."""

SIZE, FRAME_COUNT = 32, 6


@dataclass(frozen=True)
class Work:
    """A working directory with a workflow of two rules."""

    folder: Path
    weights: Path

    def snakemake(self, *arguments: str, **config: dict) -> str:
        """Run Snakemake for features.zarr with additional configuration and return its output."""
        models = {"clip_model": "model", "clip_checkpoint": str(self.weights)}
        (self.folder / "mine.yaml").write_text(
            yaml.safe_dump({"models": models, "run": {"device": "cpu"}, **config})
        )
        options = ["--snakefile", "workflow/Snakefile", "--cores", "1", "--configfile", "mine.yaml"]
        words = [*options, *arguments, "--", f"{SCENE}/features.zarr"]
        done = run_snakemake(words, self.folder, os.environ)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def stale(self, **config: dict) -> set[str]:
        """Names of the rules that would run."""
        lines = self.snakemake("--dry-run", "--quiet", "host", **config).splitlines()
        return {line.split()[1].rstrip(":") for line in lines if line.startswith("rule ")}


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Work:
    """A working directory in which both rules have run, on six frames with two instances."""
    folder = tmp_path_factory.mktemp("features")
    shutil.copytree(ROOT / "workflow", folder / "workflow", ignore=shutil.ignore_patterns("profiles"))
    shutil.copytree(ROOT / "config" / "presets", folder / "config" / "presets")
    (folder / "workflow" / "Snakefile").write_text(SNAKEFILE)
    header = "dataset\tscene\tformat\trecording\toptions\n"
    (folder / "config" / "scenes.tsv").write_text(f"{header}mine\tscene\tplain\trecording\t{UNSURVEYED}\n")
    (folder / "recording").mkdir()
    (folder / "model").mkdir()
    made = Work(folder, write_tiny_clip(folder / "model") / CHECKPOINT)
    write_inputs(folder / SCENE)
    made.snakemake(features={"dims": 3})
    return made


def write_inputs(folder: Path) -> None:
    """Write frames.zarr and instances.zarr."""
    labels = np.full((FRAME_COUNT, 1, SIZE, SIZE), -1, np.int32)
    labels[:, 0, 4:14, 4:20] = 0
    labels[:, 0, 20:30, 4:20] = 1
    arrays = {
        "rgb": np.random.default_rng(0).integers(256, size=(FRAME_COUNT, SIZE, SIZE, 3), dtype=np.uint8),
        "train": np.arange(FRAME_COUNT) < 5,
        "labels": labels,
        "instances/level": np.zeros(2, np.int8),
    }
    facts = {"format": "plain", "upright": True, "levels": ["whole"]}
    put_scene(folder, ["frames", "instances"], arrays, facts, stage="frames", origin="real")


def test_both_artifacts_are_made_and_then_nothing_is_to_be_done(work):
    views, features = (
        verify(work.folder / SCENE / f"{name}.zarr", SCHEMAS) for name in ("view_features", "features")
    )
    assert views.shape("feature") == (10, 8) and features.shape("code") == (10, 3)
    assert features.provenance["inputs"] == {"view_features.zarr": views.digest}
    assert work.stale(features={"dims": 3}) == set()


@pytest.mark.parametrize(
    "config, expected",
    [
        ({"features": {"dims": 4}}, {"features"}),
        ({"features": {"dims": 3, "mad_norm": "euclidean"}}, {"features"}),
        ({"features": {"dims": 3}, "view_features": {"max_views": 2}}, BOTH),
        ({"features": {"dims": 3}, "splats": {"iterations": 5}}, set()),
    ],
)
def test_a_changed_key_reruns_its_stage_and_what_follows(work, config, expected):
    assert work.stale(**config) == expected


def test_another_checkpoint_of_the_same_name_makes_both_stale(work):
    before = work.weights.read_bytes()
    tensors = load_file(work.weights)
    tensors["visual.proj"] += 1
    save_file(tensors, work.weights)
    try:
        assert work.stale(features={"dims": 3}) == BOTH
    finally:
        work.weights.write_bytes(before)
