"""Stage ``annotations``: read the instance maps of the evaluation frames. For evaluation only."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

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
    facts, every = frames.facts, frames.read("timestamp_ns")
    indices = np.flatnonzero(frames.read("evaluation")).astype(np.int64)
    camera = Camera(**facts["camera"])
    originals = Originals.of_facts(facts, every)
    keys = AnnotationKeys(camera, facts["upright"], round(options.max_age_ms * 1e6), originals)
    reader = open_annotations(facts["format"], recording_path, keys)
    made = provenance.begin_from("annotations", options.as_dict(), [frames], chosen=facts["format"])
    annotated = np.zeros(len(indices), bool)
    with create(output, ANNOTATIONS, made) as artifact:
        size = camera.height, camera.width
        artifact.allocate("instance_map", (len(indices), *size))
        layered = reader if isinstance(reader, LayeredAnnotations) else None
        covered = layered.covered if layered else 0
        if covered:
            artifact.allocate("covered_map", (len(indices), covered, *size))
        for row, time in enumerate(track(every[indices], "reading annotations", total=len(indices))):
            instance_map = reader.instance_map(int(time)) if reader else None
            annotated[row] = instance_map is not None
            nothing = np.full((1 + covered, *size), -1, np.int32)
            artifact.put_row("instance_map", row, nothing[0] if instance_map is None else instance_map)
            if layered and covered:
                beside = layered.covered_map(time) if annotated[row] else nothing[1:]
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
    missing = ", ".join(map(str, indices[~annotated]))
    lacking = f"; not annotated (indices from 0): {missing}" if missing else ""
    log(f"{annotated.sum()} of {len(indices)} evaluation frames are annotated{lacking}")


def open_annotations(format: str, path: Path, keys: AnnotationKeys) -> Annotations | None:
    """Open the annotations of a recording, a ``path`` as for its frames; None if it has none.

    Raises:
        UserError: the format is unknown, the recording missing, or its annotations unreadable.
    """
    return load_module("annotations", format).open_annotations(path, keys)
