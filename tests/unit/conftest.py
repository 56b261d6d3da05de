"""A scene that can be asked: two halves of a wall that mean a couch and a cup, as a folder of artifacts."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from egosplat.artifacts.provenance import begin
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.pipeline.survey_file import digest_of
from egosplat.pipeline.validation import write_document
from egosplat.query.text import encode_phrases
from egosplat.survey.stage import FORMAT_VERSION
from tests.support.gaussian_scene import (  # noqa: F401
    SETTINGS,
    camera_to_world,
    opaque,
    photographs,
    pictures,
    points,
    scene,
    truth,
)
from tests.support.pretended_gpu import gpu  # noqa: F401
from tests.support.scenes import camera_facts, digests, put
from tests.support.tiny_clip import write_tiny_clip

SIZE = 48
CAMERA = Camera(SIZE, SIZE, 44.0, 44.0, SIZE / 2, SIZE / 2)
SMALL = {"clip_model": "small", "clip_checkpoint": "small"}
LIGHTER = 20
"""By so much the photograph of the right half, a cup that moves, is lighter than its render."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def with_threads() -> Iterator[Callable[..., Any]]:
    """``with_threads(count, function, *arguments)``: the result of a function with so many threads of torch."""
    before = torch.get_num_threads()

    def call(count: int, function: Callable[..., Any], *arguments: object) -> Any:
        torch.set_num_threads(count)
        return function(*arguments)

    yield call
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def survey_that_keeps() -> Callable[..., Path]:
    """``survey_that_keeps(folder, frames)``: a survey of the folder's frames that leaves out all others.
    Something moves, unless ``static``."""

    def make(folder: Path, kept: list[int], *, static: bool = False, cells: Sequence[dict] = ()) -> Path:
        motion = {
            "verdict": "something moves",
            "masking": "none" if static else "refined",
            "share": 0.1 * (not static),
        }
        motion |= {"fleeting": 0.0, "min_share": 0.008, "voting": 0.7, "noise_px": 0.1, "pairs": []}
        camera = {"pose_residual_px": 0.1, "pose_noise_px": 0.1, "revisits": 0, "refine_poses": False}
        views = {"kept": kept, "left_out": [], "digest": digest_of(kept)}
        document = {
            "format_version": FORMAT_VERSION,
            "origin": "synthetic",
            "motion": motion,
            "camera": camera | {"brightness_stops": 0.1, "compensate_exposure": False},
            "views": views | {"min_view_change_deg": 3.0, "median_depth_m": 2.0},
            "cells": [*cells],
            "poses": {"source": "device", "registered": 1, "frames": 1, "points": 1},
            "provenance": begin("survey", {}, "synthetic", digests(folder, ["frames"])).record(),
        }
        write_document(folder / "survey.json", document, "survey")
        return folder / "survey.json"

    return make


@pytest.fixture(scope="session")
def couch_and_cup() -> torch.Tensor:
    """(2, D) float32 directions of the words by the small OpenCLIP."""
    return encode_phrases(load_open_clip("small", "small", "cpu", "float32"), ["couch", "cup"])


@pytest.fixture(scope="session")
def tiny_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with description, vocabulary and checkpoint of an OpenCLIP of 8 channels, in half precision."""
    return write_tiny_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="session")
def halves() -> Gaussians:
    """Opaque Gaussians on a plane 2 m ahead."""
    along = np.linspace(-1.6, 1.6, 24)
    xyz = np.stack(np.meshgrid(along, along, [2.0]), axis=-1).reshape(-1, 3)
    return opaque(xyz, np.full((len(xyz), 3), 120, np.uint8))


@pytest.fixture
def word_scene(tmp_path: Path, word_scene_in: Callable[..., Path]) -> Callable[..., Path]:
    """``word_scene_in`` the test's folder."""
    return partial(word_scene_in, tmp_path)


@pytest.fixture(scope="session")
def word_scene_in(halves: Gaussians, couch_and_cup: torch.Tensor) -> Callable[..., Path]:
    """``word_scene_in(folder, ...)``: the folder with all that queries and metrics need. Four frames of one view: 0 is trained on, 1
    held out, 2 evaluated though trained on, 3 evaluated without a pose. ``clip_hash``: of the OpenCLIP that features.zarr says it was
    made with, by default the small one. ``inputs``: more that it says it was made from. ``nudge``: meters by which the stored Gaussians
    are off. ``origin``: that all artifacts tell. ``evaluated``: the evaluation frames; of none, every frame is trained on.
    ``corrections``: optional arrays of splats.zarr. ``clip_model``: that features.zarr names."""

    def make(
        folder: Path,
        clip_hash: str | None = None,
        inputs: dict[str, str] | None = None,
        nudge: float = 0.0,
        origin: str = "synthetic",
        evaluated: tuple[int, ...] = (1, 2, 3),
        corrections: Mapping[str, np.ndarray] | None = None,
        clip_model: str = "small",
    ) -> Path:
        write = partial(put, folder, origin=origin)
        clip_hash = clip_hash or model_hash(CLIP, SMALL)
        [photograph] = photographs(halves, np.eye(4)[None], CAMERA)
        lighter = photograph.copy()
        lighter[:, SIZE // 2 :] += LIGHTER
        meant = couch_and_cup.numpy()[(halves.means[:, 0] > 0).int().numpy()]
        levels, is_evaluated = ["part", "whole"], np.isin(np.arange(4), evaluated)
        frames = {
            "rgb": np.stack([lighter] * 4),
            "valid": np.arange(SIZE)[:, None] + np.zeros((1, SIZE)) >= 2,
            "train": np.array([True, False, True, False]) | ~is_evaluated,
            "evaluation": is_evaluated,
        }
        write("frames", frames, camera_facts(CAMERA))
        poses = {
            "camera_to_world": np.stack([np.eye(4)] * 3 + [np.full((4, 4), np.nan)]),
            "registered": np.array([True, True, True, False]),
            "intrinsics": CAMERA.matrix,
        }
        write("poses", poses, made_from=["frames"])
        things = [
            {"id": 1, "name": "Couch_1", "category": "couch", "motion_type": "static"},
            {"id": 2, "name": "Cup_1", "category": "cup", "motion_type": "dynamic"},
        ]
        cup_on_the_right = (np.arange(SIZE) >= SIZE // 2).astype(np.int32)
        seen = np.tile(cup_on_the_right, (len(evaluated), SIZE, 1))
        arrays = {"frame": np.array(evaluated, np.int64), "instance_map": seen}
        facts = {"instances": [thing | {"instance_type": "object"} for thing in things]}
        write("annotations", arrays, facts, made_from=["frames"])
        arrays = {"instances/level": np.array([1, 1], np.int8), "consistent": couch_and_cup.numpy()}
        clip = {"model": clip_model, "checkpoint": "small", "hash": clip_hash, "small": True}
        facts = {"levels": levels, "clip": clip, "decoder": {"widths": [meant.shape[1]]}}
        models = {"clip_checkpoint": clip_hash}
        write("features", arrays, facts, options=SMALL, inputs=inputs, models=models)
        names = ("means", "quats", "log_scales", "logit_opacities", "sh")
        stored = {name: getattr(halves, name).numpy() for name in names}
        stored["means"] = stored["means"] + np.float32(nudge)
        renders = photograph[None][: 1 in evaluated]
        held_out = {"held_out/frame": np.arange(1, 1 + len(renders)), "held_out/render": renders}
        facts = {"camera": asdict(CAMERA), "sh_degree_in_use": 0, "views": {"training": 2}}
        facts |= {"highlight_compression": 0.0} if corrections else {}
        arrays, options = stored | held_out | dict(corrections or {}), asdict(SETTINGS) | {"seed": 3}
        write("splats", arrays, facts, options=options, made_from=["frames", "poses"])
        share = np.tile(np.float32([0, 1]), (len(meant), 1))
        arrays = {"code": np.stack([np.zeros_like(meant), meant], axis=1), "share": share}
        made_from = ["frames", "poses", "features", "splats"]
        write("language", arrays, {"levels": levels}, made_from=made_from)
        return folder

    return make
