"""Stage ``annotations``: read the instance maps of the evaluation frames. For evaluation only."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, FRAMES
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.frames.keys import AnnotationKeys, Originals
from egosplat.frames.options import AnnotationsOptions
from egosplat.frames.recording import Annotations, LayeredAnnotations
from egosplat.geometry import Camera
from egosplat.pipeline.stages import load_module
from egosplat.progress import log, track


def run(recording_path: Path, frames_path: Path, output: Path, options: AnnotationsOptions) -> None:
    """Write the annotations artifact of the evaluation frames of ``frames``; of a recording without any, an empty one.

    Raises:
        UserError: an annotation is damaged or does not fit its frame, or no evaluation frame has one.
    """
    frames = open_artifact(frames_path, FRAMES)
    facts = frames.facts
    indices = np.flatnonzero(frames.read("evaluation")).astype(np.int64)
    times = frames.read("timestamp_ns")[indices]
    camera = Camera(**facts["camera"])
    originals = Originals.of_facts(facts, frames.read("timestamp_ns"))
    keys = AnnotationKeys(camera, facts["upright"], round(options.max_age_ms * 1e6), originals)
    reader = open_annotations(facts["format"], recording_path, keys)
    made = provenance.begin_from("annotations", options.as_dict(), [frames], chosen=facts["format"])
    annotated = np.zeros(len(indices), bool)
    with create(output, ANNOTATIONS, made) as artifact:
        size = camera.height, camera.width
        artifact.allocate("instance_map", (len(indices), *size))
        covered = reader.covered if isinstance(reader, LayeredAnnotations) else 0
        if covered:
            artifact.allocate("covered_map", (len(indices), covered, *size))
        for row, time in enumerate(track(times, "reading annotations", total=len(times))):
            instance_map = reader.instance_map(int(time)) if reader else None
            annotated[row] = instance_map is not None
            if instance_map is None:
                instance_map = np.full(size, -1, np.int32)
            artifact.put_row("instance_map", row, instance_map)
            if covered:
                beside = (
                    reader.covered_map(time) if annotated[row] else np.full((covered, *size), -1, np.int32)
                )
                artifact.put_row("covered_map", row, beside)
        if reader and not annotated.any():
            raise UserError(
                f"{recording_path}: none of the {len(indices)} evaluation frames is annotated. Are the annotations of "
                "this recording? If so, they cover a part of it: take that part (frames.start_s, frames.end_s), or raise "
                "frames.evaluation_frames."
            )
        artifact.put("frame", indices)
        artifact.put("annotated", annotated)
        artifact.facts = {"instances": [asdict(instance) for instance in reader.instances] if reader else []}
    log(_summary(indices, annotated))


def _summary(frames: NDArray[np.int64], annotated: NDArray[np.bool_]) -> str:
    """The log line with the number of annotated evaluation frames and the indices of the others."""
    line = f"{annotated.sum()} of {len(frames)} evaluation frames are annotated"
    missing = ", ".join(map(str, frames[~annotated]))
    return f"{line}; not annotated (indices from 0): {missing}" if missing else line


def open_annotations(format: str, path: Path, keys: AnnotationKeys) -> Annotations | None:
    """Open the annotations of a recording, a ``path`` as for its frames; None if it has none.

    Raises:
        UserError: the format is unknown, the recording missing, or its annotations unreadable.
    """
    return load_module("annotations", format).open_annotations(path, keys)
