"""Stage ``frames``: read and rectify the frames of a recording, and split them into training and evaluation."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.writer import create
from egosplat.frames.readers import open_recording
from egosplat.frames.recording_files import is_annotated
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
    known_poses: str
    lens: str
    pick: str


def run(recording_path: Path, output: Path, options: FramesOptions, *, format: str) -> None:
    """Read a recording of a given format and write its frames artifact.

    Raises:
        UserError: the recording is missing or damaged, or the keys select no frame.
    """
    reader = open_recording(
        format,
        recording_path,
        resolution=options.resolution,
        focal=options.focal,
        upright=options.upright,
        stride=options.stride,
        start_s=options.start_s,
        end_s=options.end_s,
        known_poses=options.known_poses,
        lens=options.lens,
        pick=options.pick,
    )
    capture = reader.capture
    count = len(capture.timestamp_ns)
    annotated = is_annotated(format, recording_path)
    held_out = evaluation_count(options.evaluation_frames, count, annotated)
    train, evaluation = split_frames(count, held_out, options.holdout)
    made = provenance.begin("frames", asdict(options) | {"format": format}, capture.origin, chosen=format)
    with create(output, FRAMES, made) as artifact:
        artifact.put("valid", capture.valid)
        artifact.put("timestamp_ns", capture.timestamp_ns)
        artifact.put("exposure_middle_ns", capture.exposure_middle_ns)
        artifact.put("train", train)
        artifact.put("evaluation", evaluation)
        artifact.allocate("rgb", (count, *capture.valid.shape, 3))
        # One frame at a time: a recording does not fit into memory.
        images, sharpnesses = reader.read_frames(np.arange(count)), []
        for index, image in enumerate(track(images, f"reading {recording_path.name}", total=count)):
            artifact.put_row("rgb", index, image)
            sharpnesses.append(sharpness(image, capture.valid))
        device = capture.device_from_camera
        artifact.facts = {
            "recording": recording_path.name,
            "format": format,
            "upright": capture.upright,
            "camera": asdict(capture.camera),
            "camera_known": capture.camera_known,
            "blurred_frames": count_blurred(sharpnesses),
            "device_from_camera": None if device is None else device.tolist(),
            **capture.facts,
        }
    log(_split_line(count, int(evaluation.sum()), options.evaluation_frames == AUTO and not annotated))


def _split_line(count: int, evaluation: int, unannotated: bool) -> str:
    """The log line about the split."""
    if unannotated:
        return (
            f"{count} frames, all for training: the recording has no annotations "
            "(frames.evaluation_frames=N holds N of them out)"
        )
    return f"{count} frames, {evaluation} of them for evaluation"


# Measured on photographs of 512 px: a Gaussian blur of 1 px leaves 0.10 to 0.14 of the median sharpness, of 0.5 px
# it leaves 0.5. The least sharp frame of a synthetic apartment and of two photo series has 0.59.
# A frame below this fraction of the recording's median sharpness counts as blurred.
BLURRED = 0.25


def sharpness(image: NDArray[np.uint8], valid: NDArray[np.bool_]) -> float:
    """Variance of the Laplacian of the gray image over valid pixels; 0 if there is none.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool: pixels that show the scene.
    """
    # Erosion drops pixels whose Laplacian includes an invalid neighbor.
    inside = cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    laplacian = cv2.Laplacian(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.CV_64F)[inside]
    return float(laplacian.var()) if len(laplacian) else 0.0


def count_blurred(values: Sequence[float]) -> int:
    """Number of blurred or blank frames, from the ``sharpness`` of every frame of a recording."""
    limit = BLURRED * float(np.median(values))
    # A sharpness of 0 is blank even if the median is 0.
    return sum(value < limit or value == 0.0 for value in values)
