"""Each published architecture of the catalogue loads from a file in its published format and runs, SAM2's smallest and OpenCLIP also in
bfloat16. The weights are random: no published file is here. Loading, shapes and dtypes do not depend on their values."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from benchmarks.published_weights import save_clip, save_encoder, save_sam2
from egosplat.artifacts.reader import open_artifact, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.compute import choose_compute
from egosplat.features import view_features_stage
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import build_model, load_open_clip, read_description
from egosplat.pipeline.config import Config, resolve, stage_values
from egosplat.pipeline.model_sets import CATALOGUE, ENCODER, LIBRARIES, locate_checkpoints, named_model
from egosplat.query.text import encode_phrases
from egosplat.segments import stage as segments_stage
from egosplat.segments.options import MASK_FILTERS, MaskFilter, SegmentsOptions
from egosplat.transient.network import ENCODER as NETWORK_ENCODER
from egosplat.transient.network import make_network
from tests.support import PRESETS
from tests.support.scenes import LEVELS, put

pytestmark = pytest.mark.slow

PRECISIONS = ("float32", "bfloat16")
SAVE = {"SAM2": save_sam2, "OpenCLIP": save_clip, "timm": save_encoder}
# Channels of the features of each OpenCLIP.
WIDTHS = {"ViT-B-32-256": 512, "ViT-B-16": 512, "ViT-B-16-quickgelu": 512, "ViT-L-14": 768}
SAM2 = [one.architecture for one in CATALOGUE if one.library == "SAM2"]
# Random masks pass these thresholds. Their logits are flat, so that an offset of 1 would leave nothing.
EVERY_MASK = MaskFilter(0.0, 0.0, 0.01, 0.0, nms_inner_thresh=0.0)
FEW = {"image_size": 128, "points_per_side": 2, "crops_per_side": 1, "max_instances": 2}
FEW |= {"min_area": 0.0, "min_frames": 1}


@pytest.fixture
def cache(tmp_path: Path) -> Iterator[Path]:
    """A folder of checkpoints; they are removed at once, because they take gigabytes."""
    (folder := tmp_path / "cache").mkdir()
    yield folder
    shutil.rmtree(folder)


def saved(cache: Path, architecture: str) -> Path:
    """A checkpoint with random weights, under the name that the download gives it."""
    model = named_model(architecture)
    torch.manual_seed(0)
    SAVE[model.library](cache / model.file, architecture)
    return cache / model.file


def configured(cache: Path, precision: str, **models: str) -> Config:
    """The configuration of a user who sets ``models.set: published``."""
    keys = {"set": "published", "cache": str(cache)} | models
    run = {"device": "cpu", "precision": precision}
    return locate_checkpoints(resolve({"models": keys, "run": run}, PRESETS))


def with_two_blocks(*arguments: str) -> OpenClip:
    """Load OpenCLIP whole; run two blocks of each transformer. All blocks are alike, and in bfloat16 a
    processor without instructions for it needs a second for each."""
    clip = load_open_clip(*arguments)
    for transformer in (clip.model.visual.transformer, clip.model.transformer):
        del transformer.resblocks[2:]
    return clip


@pytest.mark.parametrize("architecture", SAM2)
def test_sam2_segments_and_tracks(cache, tmp_path, architecture, monkeypatch):
    saved(cache, architecture)
    monkeypatch.setitem(MASK_FILTERS, "published", EVERY_MASK)
    # The smallest runs each way; the rest of the code is the same for all, and slow where a processor has no bfloat16.
    smallest = architecture == SAM2[0]
    count, rng = 3 if smallest else 2, np.random.default_rng(0)
    rgb = np.kron(rng.integers(0, 256, (count, 8, 8, 3), np.uint8), np.ones((1, 8, 8, 1), np.uint8))
    frames = put(tmp_path, "frames", {"rgb": rgb, "valid": np.ones((64, 64), bool)}, {"upright": True})
    for precision in PRECISIONS if smallest else PRECISIONS[:1]:
        values = stage_values("segments", configured(cache, precision, sam2_config=architecture))
        assert Path(values["sam2_checkpoint"]).parent == cache
        each_way = smallest and precision == "float32"
        for prompting in ("initial_frame", "each_frame") if each_way else ("initial_frame",):
            options = values | FEW | {"prompting": prompting, "track_moving": "never"}
            output = tmp_path / f"{precision}_{prompting}.zarr"
            segments_stage.run(frames, output, options=SegmentsOptions(**options))
            found = verify(output, SCHEMAS)
            labels = found.read("labels")
            assert labels.shape == (count, 3, 64, 64) and labels.max() >= 0
            assert np.isfinite(found.read("instances/predicted_iou")).all()


def test_open_clip_encodes_views(cache, tmp_path, monkeypatch):
    saved(cache, "ViT-B-16")
    monkeypatch.setattr(view_features_stage, "load_open_clip", with_two_blocks)
    rgb = np.random.default_rng(0).integers(0, 256, (2, 48, 48, 3), np.uint8)
    labels = np.full((2, 2, 48, 48), -1, np.int32)
    labels[0, 0, 4:30, 4:40] = 0
    frames = put(tmp_path, "frames", {"rgb": rgb}, {"upright": True, "recording": "r", "format": "adt"})
    arrays = {"labels": labels, "instances/level": np.array([0], np.int8)}
    instances = put(tmp_path, "instances", arrays, {"levels": LEVELS}, made_from=["frames"], stage="frames")
    by_precision = []
    for precision in PRECISIONS:
        options = stage_values("view_features", configured(cache, precision))
        output = tmp_path / f"{precision}.zarr"
        view_features_stage.run(frames, instances, output, view_features_stage.ViewFeaturesOptions(**options))
        by_precision.append(open_artifact(output, SCHEMAS["view_features"]).read("feature"))
        assert by_precision[-1].shape == (1, 512)
    exact, rounded = by_precision
    assert ((exact * rounded).sum(1) > 0.99).all() and not np.array_equal(exact, rounded)


@pytest.mark.parametrize("architecture", sorted(WIDTHS))
def test_every_open_clip_loads_and_encodes(cache, architecture):
    with torch.device("meta"):
        shapes = build_model(architecture, read_description(architecture, None)["model_cfg"]).state_dict()
    weights = {name: torch.full(one.shape, 0.01, dtype=torch.float16) for name, one in shapes.items()}
    weights["token_embedding.weight"].normal_(std=0.02)
    weights["visual.conv1.weight"].normal_(std=0.02)
    torch.save(weights, cache / named_model(architecture).file)
    models = configured(cache, "float32", clip_model=architecture)["models"]
    clip = with_two_blocks(models["clip_model"], models["clip_checkpoint"], "cpu", "float32")
    picture = torch.rand(1, 3, *clip.preprocessing.image_size)
    for precision in PRECISIONS:
        same = replace(clip, compute=choose_compute("cpu", precision))
        with same.compute.inference():
            assert same.model.encode_image(picture).shape == (1, WIDTHS[architecture])
        phrase = encode_phrases(same, ["a red chair"])
        assert phrase.shape == (1, WIDTHS[architecture]) and torch.isfinite(phrase).all()


def test_the_transient_networks_encoder_takes_its_weights_from_a_published_classifier(cache):
    path = saved(cache, ENCODER)
    tried = {*SAM2, *WIDTHS, ENCODER}
    assert {one.architecture for one in CATALOGUE} == tried, "a new entry needs a run here"
    assert NETWORK_ENCODER == ENCODER and LIBRARIES["transient.encoder_weights"] == "timm"
    weights = stage_values("transient", configured(cache, "float32"))["encoder_weights"]
    assert weights == str(path)
    network = make_network(64, False, Path(weights), 0)
    stored, own = load_file(path), network.encoder.state_dict()
    assert len(own) > 100 and all(torch.equal(own[name], stored[name]) for name in own)
    assert network.eval()(torch.rand(48, 48, 3), 48, 48).shape == (48, 48)
