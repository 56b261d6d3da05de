"""Stage ``frames``: read and rectify the frames of a recording, and split them into training and evaluation."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from egosplat.artifacts import provenance
from egosplat.artifacts.schemas import FRAMES
from egosplat.artifacts.shards import AS_JPEG, EXACT
from egosplat.artifacts.writer import create
from egosplat.calibration.files import is_annotated
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat.frames.selection import split_frames
from egosplat.pipeline.stages import load_module
from egosplat.progress import log, track


def run(recording_path: Path, output: Path, options: FramesOptions, *, format: str) -> None:
    """Read a recording and write its frames artifact; UserError if it is missing or damaged, or the keys select no frame."""
    recording: Recording = load_module("frames", format).open_recording(recording_path, options)
    count, valid = len(recording.timestamp_ns), recording.valid
    annotated = is_annotated(format, recording_path)
    train, evaluation = split_frames(count, options, annotated, recording.labeled)
    made = provenance.begin("frames", options.as_dict() | {"format": format}, recording.origin, chosen=format)
    with create(output, FRAMES, made) as artifact:
        artifact.put("valid", valid)
        artifact.put("timestamp_ns", recording.timestamp_ns)
        artifact.put("exposure_middle_ns", recording.exposure_middle_ns)
        artifact.put("train", train)
        artifact.put("evaluation", evaluation)
        codecs = AS_JPEG if options.storage == "jpeg" else EXACT
        artifact.allocate("rgb", (count, *valid.shape, 3), codecs)
        if recording.masked:
            artifact.allocate("masked", (count, *valid.shape))
        # One frame at a time: a recording does not fit into memory.
        images = recording.read_frames(np.arange(count))
        for index, image in enumerate(track(images, f"reading {recording_path.name}", total=count)):
            artifact.put_row("rgb", index, image)
            if recording.masked:
                artifact.put_row("masked", index, recording.masked(index))
        device = recording.device_from_camera
        artifact.facts = {
            "recording": recording_path.name,
            "format": format,
            "upright": recording.upright,
            "camera": asdict(recording.camera),
            "camera_known": recording.camera_known,
            "device_from_camera": None if device is None else device.tolist(),
            **recording.facts,
        }
    told = f"{evaluation.sum()} of them for evaluation"
    if options.evaluation_frames == "auto" and not annotated:
        told = "all for training: the recording has no annotations (frames.evaluation_frames=N holds N of them out)"
    log(f"{count} frames, {told}")
