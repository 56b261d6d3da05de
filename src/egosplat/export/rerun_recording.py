"""Write a scene for Rerun (rerun.io): cameras with pictures, instances and carries over time, Gaussians as points, answers as boxes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import INSTANCES, SPLATS
from egosplat.errors import UserError
from egosplat.export.ply import LEAST_OPACITY, instance_colors
from egosplat.files import atomic_file
from egosplat.gaussians.initialization import SH_C0
from egosplat.gaussians.io import read_gaussians
from egosplat.geometry import known_poses
from egosplat.histories.told import Carried
from egosplat.progress import log, track
from egosplat.query.answers import Answer
from egosplat.query.finished_scene import Scene


def export_rerun(scene: Scene, output: Path, phrases: Iterable[str]) -> None:
    """Write a .rrd file; it is complete or absent.

    Args:
        phrases: queries of the whole scene, whose answers become boxes, and of what was carried points over time.

    Raises:
        UserError: rerun-sdk is not installed, or an artifact is missing or damaged.
    """
    try:
        import rerun as rr
    except ImportError:
        raise UserError('rerun-sdk is not installed; it comes with: pip install "egosplat[rerun]"') from None
    answers = list(scene.answers(phrases)) if phrases else []
    up = scene.artifact("poses").read("up")
    axis = int(np.abs(up).argmax())
    axes = getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}")
    with (
        atomic_file(output) as scratch,
        rr.RecordingStream("egosplat", recording_id=scene.folder.name) as stream,
    ):
        stream.save(scratch)
        stream.log("world", axes, static=True)
        stream.log("world/gaussians", _points(rr, scene.folder), static=True)
        for answer in answers:
            stream.log(f"world/answers/{answer.phrase}", _boxes(rr, answer), static=True)
            log(f"{answer.phrase}: {answer.refusal or f'{len(answer.things)} boxes'}")
        frames = _log_frames(rr, stream, scene)
        ways = _log_ways(rr, stream, scene)
        for answer in answers:
            _log_places(rr, stream, scene, answer)
        # What is left is written before the file gets its name.
        stream.disconnect()
    log(f"{output}: {frames} frames, {len(answers)} answers, {ways} carries")


def _boxes(rr: Any, answer: Answer) -> Any:
    return rr.Boxes3D(
        centers=[thing.center for thing in answer.things],
        sizes=[thing.size for thing in answer.things],
        labels=[f"{answer.phrase} {thing.score:.2f}" for thing in answer.things],
    )


def _points(rr: Any, folder: Path) -> Any:
    """The Gaussians on surfaces, with their size and their color from all sides."""
    gaussians = read_gaussians(open_artifact(locate(folder, "splats")[0], SPLATS))
    some = gaussians.select(gaussians.opacities >= LEAST_OPACITY)
    colors = (some.sh[:, 0].numpy() * SH_C0 + 0.5).clip(0, 1)
    radii = some.scales.median(dim=1).values.numpy()
    return rr.Points3D(some.means.numpy(), colors=(colors * 255).astype(np.uint8), radii=radii)


def _log_frames(rr: Any, stream: Any, scene: Scene) -> int:
    """Log the frames with a pose, with the instances of the coarsest level; returns their number."""
    instances = open_artifact(locate(scene.folder, "instances")[0], INSTANCES)
    colors = instance_colors(instances.shape("instances/level")[0])
    # Class 0 is no instance, which is transparent.
    classes = [
        (0, "none", (0, 0, 0, 0)),
        *((i + 1, f"{i}", (*c, 255)) for i, c in enumerate(colors.tolist())),
    ]
    stream.log("world", rr.AnnotationContext(classes), static=True)
    size = {"width": scene.camera.width, "height": scene.camera.height}
    lens = rr.Pinhole(image_from_camera=scene.camera.matrix, **size)
    stream.log("world/camera", lens, static=True)
    known = known_poses(scene.poses).tolist()
    for frame in track(known, "writing frames"):
        pose, labels = scene.poses[frame], instances.row("labels", frame)[-1]
        _set_time(stream, scene, frame)
        stream.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        stream.log("world/camera/picture", rr.Image(scene.frames[frame]).compress(jpeg_quality=90))
        stream.log(
            "world/camera/instances", rr.SegmentationImage((labels + 1).astype(np.uint16), opacity=0.4)
        )
    return len(known)


def _set_time(stream: Any, scene: Scene, frame: int) -> None:
    stream.set_time("frame", sequence=frame)
    stream.set_time("time", duration=float(scene.seconds[frame]))


def _log_ways(rr: Any, stream: Any, scene: Scene) -> int:
    """Log a line for each carry whose ends are known, from its start to its end, while it lasts; returns their number."""
    every = () if scene.histories is None else scene.histories.every
    carries = [one for one in every if one.start_is_known and one.end_is_known]
    for number, one in enumerate(carries, 1):
        first, after = _frames(scene, one)
        _set_time(stream, scene, first)
        line = rr.LineStrips3D([[one.start, one.end]], labels=[one.told])
        stream.log(f"world/carries/{number}", line)
        if after < len(scene.seconds):
            _set_time(stream, scene, after)
            stream.log(f"world/carries/{number}", rr.Clear(recursive=False))
    return len(carries)


def _log_places(rr: Any, stream: Any, scene: Scene, answer: Answer) -> None:
    """Log a point where the thing of an answer lies, and none while it is carried or its place is not known."""
    changes = {frame for one in answer.history for frame in _frames(scene, one)}
    for frame in sorted({0} | changes if changes else ()):
        if frame < len(scene.seconds):
            _set_time(stream, scene, frame)
            place = answer.at(float(scene.seconds[frame]))
            known = [] if place is None or place.position is None else [place.position]
            point = rr.Points3D(known, radii=answer.history[0].size / 2, labels=[answer.phrase] * len(known))
            stream.log(f"world/places/{answer.phrase}", point)


def _frames(scene: Scene, one: Carried) -> tuple[int, int]:
    """The first frame of a carry, and the one after its last."""
    return int(scene.seconds.searchsorted(one.from_s)), int(scene.seconds.searchsorted(one.until_s)) + 1
