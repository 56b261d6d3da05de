"""Write a synthetic recording as an Aria Digital Twin sequence folder (docs/method.md#adt-files)."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.progress import track
from egosplat.synthetic.adt_format.adt_documents import write_documents
from egosplat.synthetic.adt_format.adt_images import create_images
from egosplat.synthetic.adt_format.adt_trajectory import write_trajectories
from egosplat.synthetic.adt_format.adt_truth import TruthTables
from egosplat.synthetic.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Sequence

_TRUTH_AFTER_CAPTURE_NS = 90_000


def write_sequence(sequence: Sequence, folder: Path, *, jpeg_quality: int = 95) -> None:
    """Write a complete sequence folder that projectaria-tools' ADT provider opens.

    The folder appears once it is complete. An interrupted run leaves at most a hidden scratch folder.

    Args:
        sequence: the recording; its frames are rendered one by one and not kept.
        folder: the folder to make; must not exist.
        jpeg_quality: 1 to 95.

    Raises:
        UserError: ``folder`` exists.
        ValueError: the sequence contradicts itself.
    """
    if folder.exists():
        raise UserError(f"{folder}: exists already and is not replaced; give another --output")
    with atomic_directory(folder) as scratch:
        truth = TruthTables(sequence)
        captures: list[int] = []
        with create_images(scratch, sequence, jpeg_quality) as images:
            for number, frame in enumerate(_frames(sequence)):
                truth_ns = ground_truth_ns(frame.capture_ns)
                images.write(frame, number, truth_ns)
                truth.add(frame, truth_ns)
                captures.append(frame.capture_ns)
        truth.write(scratch)
        write_documents(scratch, sequence)
        capture_ns = np.array(captures, dtype=np.int64)
        truth_times = np.array([ground_truth_ns(time) for time in captures], dtype=np.int64)
        write_trajectories(scratch, sequence, truth_times, capture_ns + ROLLING_SHUTTER_MIDDLE_NS)


def ground_truth_ns(capture_ns: int) -> int:
    """Timestamp of an image's ground truth, on the microsecond grid.

    ADT's ground truth follows the SLAM cameras, which capture about 0.09 ms after the RGB camera.
    """
    return (capture_ns + _TRUTH_AFTER_CAPTURE_NS + 500) // 1000 * 1000


def _frames(sequence: Sequence) -> Iterator[Frame]:
    """Yield the frames with a progress bar; check their order and number."""
    last_ns, count = None, 0
    for frame in track(sequence.frames(), f"writing {sequence.name}", total=sequence.frame_count):
        if last_ns is not None and frame.capture_ns <= last_ns:
            raise ValueError(f"frame {count} was captured at {frame.capture_ns} ns, not after {last_ns} ns")
        last_ns = frame.capture_ns
        count += 1
        yield frame
    if count != sequence.frame_count:
        raise ValueError(f"{count} frames, not {sequence.frame_count}")
