"""Write a scene for Rerun (rerun.io): cameras with pictures and instances over time, Gaussians as points, answers as boxes."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.errors import from_extra
from egosplat.export.gaussians import LEAST_OPACITY, instance_colors
from egosplat.files import atomic_file
from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import known_poses
from egosplat.progress import log, track
from egosplat.query.answers import Answer
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import Grading


def export_rerun(scene: Scene, output: Path, query: str | None) -> None:
    """Write a .rrd file, whole or not at all, with boxes of the answers to a query in the whole scene
    (UserError: rerun-sdk is not installed, or an artifact is missing or damaged)."""
    with from_extra("rerun"):
        import rerun as rr
    answers = scene.ask(query) if query else []
    up = scene.artifact("poses").read("up")
    axis = int(np.abs(up).argmax())
    axes = f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}"
    with (
        atomic_file(output) as scratch,
        rr.RecordingStream("egosplat", recording_id=scene.folder.name) as stream,
    ):
        stream.save(scratch)
        stream.log("world", getattr(rr.ViewCoordinates, axes), static=True)
        stream.log("world/gaussians", _points(rr, scene.gaussians.to(torch.device("cpu"))), static=True)
        frames = _log_frames(rr, stream, scene)
        for answer in answers:
            stream.log(f"world/answers/{answer.asked}", _boxes(rr, answer, scene.grading()), static=True)
            log(f"{answer.asked}: {answer.refusal or f'{len(answer.things)} boxes'}")
        # What is left is written before the file gets its name.
        stream.disconnect()
    log(f"{output}: {frames} frames, {len(answers)} answers")


def _boxes(rr: Any, answer: Answer, grading: Grading) -> Any:
    about = f"{answer.asked}, {answer.grade}, {grading.measure}"
    return rr.Boxes3D(
        centers=[thing.center for thing in answer.things],
        sizes=[thing.size for thing in answer.things],
        labels=[f"{about} {grading.shown(thing.rating)}" for thing in answer.things],
    )


def _points(rr: Any, gaussians: Gaussians) -> Any:
    """The Gaussians on surfaces, with their size and their color from all sides."""
    shown = gaussians.select(gaussians.opacities >= LEAST_OPACITY)
    colors = (shown.sh[:, 0].numpy() * SH_C0 + 0.5).clip(0, 1)
    radii = shown.scales.median(dim=1).values.numpy()
    return rr.Points3D(shown.means.numpy(), colors=(colors * 255).astype(np.uint8), radii=radii)


def _log_frames(rr: Any, stream: Any, scene: Scene) -> int:
    """Log the frames with a pose, with the instances of the coarsest level; returns their number."""
    instances = scene.artifact("instances")
    colors = instance_colors(instances.shape("instances/level")[0]).tolist()
    # Class 0 is no instance, which is transparent.
    classes = [(number, f"{number - 1}", (*color, 255)) for number, color in enumerate(colors, 1)]
    stream.log("world", rr.AnnotationContext([(0, "none", (0, 0, 0, 0)), *classes]), static=True)
    size = {"width": scene.camera.width, "height": scene.camera.height}
    stream.log("world/camera", rr.Pinhole(image_from_camera=scene.camera.matrix, **size), static=True)
    known = known_poses(scene.poses).tolist()
    for frame in track(known, "writing frames"):
        pose, labels = scene.poses[frame], (instances.row("labels", frame)[-1] + 1).astype(np.uint16)
        stream.set_time("frame", sequence=frame)
        stream.set_time("time", duration=float(scene.seconds[frame]))
        stream.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        stream.log("world/camera/picture", rr.Image(scene.frames[frame]).compress(jpeg_quality=90))
        stream.log("world/camera/instances", rr.SegmentationImage(labels, opacity=0.4))
    return len(known)
