"""Stage ``frames``: a recording's rectified pictures and the train / evaluation split."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from egosplat.artifacts import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.writer import create
from egosplat.frames.companions import is_annotated
from egosplat.frames.readers import open_recording
from egosplat.frames.sharpness import blurred, sharpness
from egosplat.frames.split import AUTO, evaluation_count, split_frames
from egosplat.progress import log, track


@dataclass(frozen=True)
class FramesOptions:
    """The schema's keys of ``frames``; ``config.schema.yaml`` describes each."""

    resolution: int
    focal: float
    upright: bool
    stride: int
    start_s: float
    end_s: float | None
    evaluation_frames: int | str
    holdout: bool


def run(recording: Path, output: Path, options: FramesOptions, *, format: str) -> None:
    """Read ``recording``, which is laid out as ``format`` says, and write its frames artifact.

    Raises:
        UserError: the recording is absent, damaged, or the keys select no frame.
    """
    reader = open_recording(
        format,
        recording,
        resolution=options.resolution,
        focal=options.focal,
        upright=options.upright,
        stride=options.stride,
        start_s=options.start_s,
        end_s=options.end_s,
    )
    capture = reader.capture
    count = len(capture.timestamp_ns)
    annotated = is_annotated(format, recording)
    held_out = evaluation_count(options.evaluation_frames, count, annotated)
    train, evaluation = split_frames(count, held_out, options.holdout)
    made = provenance.begin("frames", asdict(options) | {"format": format}, capture.origin)
    with create(output, FRAMES, made) as artifact:
        artifact.put("valid", capture.valid)
        artifact.put("timestamp_ns", capture.timestamp_ns)
        artifact.put("exposure_middle_ns", capture.exposure_middle_ns)
        artifact.put("train", train)
        artifact.put("evaluation", evaluation)
        artifact.allocate("rgb", (count, *capture.valid.shape, 3))
        pictures, sharp = reader.pictures(np.arange(count)), []
        for index, picture in enumerate(track(pictures, f"reading {recording.name}", total=count)):
            artifact.put_row("rgb", index, picture)
            sharp.append(sharpness(picture, capture.valid))
        device = capture.device_from_camera
        artifact.facts = {
            "recording": recording.name,
            "format": format,
            "upright": capture.upright,
            "camera": asdict(capture.camera),
            "camera_known": capture.camera_known,
            "blurred_frames": blurred(sharp),
            "device_from_camera": None if device is None else device.tolist(),
        }
    log(_split_line(count, int(evaluation.sum()), options.evaluation_frames == AUTO and not annotated))


def _split_line(count: int, evaluation: int, unannotated: bool) -> str:
    """How the frames are split, in one line."""
    if unannotated:
        return (
            f"{count} frames, all trained on: the recording has no annotations to evaluate with "
            "(frames.evaluation_frames=N holds N of them out)"
        )
    return f"{count} frames, {evaluation} of them for evaluation"
