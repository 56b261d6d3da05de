"""Scores as they lie below results, without the work that makes them."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from egosplat.evaluation.document import FORMAT_VERSION
from tests.support.scores import OPTIONS, SETUP

SCENE = "results/adt/scene1"
QUERIES = 80


def record(stage: str, wall_s: float, **more: Any) -> dict[str, Any]:
    """Provenance of a stage that took so long."""
    made = {"stage": stage, "options": {}, "origin": "synthetic", "inputs": {}, "models": {}, "code": "c0de"}
    made |= {"versions": {}, "created": "2026-01-01T00:00:00+00:00", "machine": "a processor, 2 cores"}
    return made | {"wall_s": wall_s, "cpu_s": 2 * wall_s, "peak_memory_mb": 500.0 + wall_s} | more


def document(scene: str, accuracy: float, psnr: float | None, stages: Mapping[str, dict]) -> dict[str, Any]:
    """Of a scene whose artifacts cost what ``stages`` says."""
    per_frame = ("annotated", "asked", "trained_on", "without_pose")
    names = [
        "frames",
        "training_frames",
        "evaluation_frames",
        *(f"evaluation_frames_{one}" for one in per_frame),
    ]
    counts = dict.fromkeys((*names, "annotated_instances", "transient_instances", "views"), 3)
    counts |= {"instances": {}, "gaussians": 1000, "gaussians_with_code": {}, "code_channels": 4}
    score = {"count": QUERIES, "categories": 20, "accuracy": accuracy, "accuracy_interval": [0.0, 1.0]}
    score |= {"mean_iou": accuracy / 2, "mean_iou_interval": [0.0, 1.0]}
    score |= {"random_pixel": 0.05, "middle_pixel": 0.15}
    rendering = {"frames": 3, "psnr": psnr, "ssim": 0.8}
    return {
        "format_version": FORMAT_VERSION,
        "scene": scene,
        "origin": "synthetic",
        **SETUP,
        "notice": None,
        "alarms": [],
        "counts": counts,
        "scores": dict.fromkeys(("static", "dynamic", "all"), score),
        "queries": [],
        "length_unit": "m",
        "presence": {
            "min_score": 0.5,
            "separation": None,
            "present": dict.fromkeys(
                ("asked", "answered", "right", "unverified", "guessed", "guessed_right"), 0
            ),
            "absent": dict.fromkeys(("asked", "answered", "untaught", "guessed"), 0),
            "queries": [],
        },
        "rendering": dict.fromkeys(("static", "dynamic", "all"), rendering),
        "frames": [],
        "models": {"clip_checkpoint": {"checkpoint": "small", "hash": "c0de" * 4, "small": True}},
        "total": {"wall_s": None, "peak_memory_mb": None},
        "artifacts": {
            f"{name}.zarr": made | {"digest": "d", "disk_mb": 10.0} for name, made in stages.items()
        },
        "provenance": record("metrics", 30.0, options=OPTIONS),
    }


@pytest.fixture
def scored(tmp_path: Path) -> Callable[..., str]:
    """``scored(variant, accuracy, minutes, ...)``: the path of scores; splats take the minutes."""

    def write(
        variant: str | None,
        accuracy: float = 0.5,
        minutes: float = 10.0,
        psnr: float | None = 25.0,
        options: Mapping[str, dict] | None = None,
        place: str = SCENE,
        **more: Any,
    ) -> str:
        stages = {
            "frames": record("frames", 1.0),
            "annotations": record("annotations", 600.0),
            "splats": record("splats", 60.0 * minutes),
        }
        for stage, own in (options or {}).items():
            stages[stage]["options"] = own
        folder = tmp_path / place / (f"variants/{variant}" if variant else "")
        folder.mkdir(parents=True, exist_ok=True)
        name = place.partition("/")[2]
        content = document(f"{name}, {variant}" if variant else name, accuracy, psnr, stages)
        (folder / "metrics.json").write_text(json.dumps(content | more))
        return str(folder / "metrics.json")

    return write


@pytest.fixture
def point(scored) -> Callable[..., dict[str, Any]]:
    """``point(settings, accuracies, minutes)``: a point, a run a number; the scene itself where ``scene`` is true."""

    def make(
        settings: Sequence[tuple[str, Any]],
        accuracies: Sequence[float],
        minutes: Sequence[float],
        scene: bool = False,
        **more: Any,
    ) -> dict[str, Any]:
        name = "-".join(f"{knob}-{value}".replace(".", "-") for knob, value in settings)
        paths = []
        for seed, (accuracy, time) in enumerate(zip(accuracies, minutes, strict=True)):
            variant = (
                (None if scene else name) if seed == 0 else f"seed-{seed}" if scene else f"{name}-seed-{seed}"
            )
            paths.append(scored(variant, accuracy, time, **more))
        keys = {knob: value for knob, value in settings if knob != "preset"}
        recipe = {"keys": keys, "command": f"snakemake --cores 2 {paths[0]}"}
        return {"settings": [list(one) for one in settings], "recipe": recipe, "metrics": paths}

    return make


@pytest.fixture
def three_points(point) -> list[dict[str, Any]]:
    """The scene (balanced), the paper's settings, and fewer iterations, three runs each."""
    own = [("splats.iterations", 7000), ("preset", "balanced")]
    return [
        point(own, [0.50, 0.51, 0.49], [10.0, 10.2, 9.8], scene=True),
        point([("preset", "paper_scaled")], [0.52, 0.48, 0.50], [99.0, 100.0, 101.0]),
        point([("splats.iterations", 1500)], [0.40, 0.41, 0.39], [2.5, 2.6, 2.4]),
    ]
