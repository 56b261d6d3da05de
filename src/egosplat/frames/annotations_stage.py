"""Stage ``annotations``: read the instance maps of the evaluation frames. For evaluation only."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.arrays import Ints
from egosplat.artifacts import provenance
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, FRAMES
from egosplat.artifacts.writer import create
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.frames.options import AnnotationsOptions
from egosplat.frames.recording import AnnotationKeys, Annotations
from egosplat.geometry import Camera
from egosplat.pipeline.stages import load_module
from egosplat.progress import log, track


def run(recording_path: Path, frames_path: Path, output: Path, options: AnnotationsOptions) -> None:
    """Write the annotations artifact of the evaluation frames of ``frames``; of a recording without any, an empty one. UserError if
    an annotation is damaged or does not fit its frame, or no evaluation frame has one."""
    frames = open_artifact(frames_path, FRAMES)
    format, times = frames.facts["format"], frames.read("timestamp_ns")
    indices = np.flatnonzero(frames.read("evaluation")).astype(np.int64)
    keys = _keys(frames.facts, times)
    reader: Annotations | None = load_module("annotations", format).open_annotations(recording_path, keys)
    made = provenance.begin_from("annotations", options.as_dict(), [frames], chosen=format)
    annotated, covered = np.zeros(len(indices), bool), reader.covered if reader else 0
    with create(output, ANNOTATIONS, made) as artifact:
        size = keys.camera.height, keys.camera.width
        artifact.allocate("instance_map", (len(indices), *size))
        if covered:
            artifact.allocate("covered_map", (len(indices), covered, *size))
        for row, time in enumerate(track(times[indices], "reading annotations", total=len(indices))):
            layers = np.full((1 + covered, *size), -1, np.int32)
            if reader and (read := reader.read(int(time))) is not None:
                annotated[row], layers[: len(read)] = True, read
            artifact.put_row("instance_map", row, layers[0])
            if covered:
                artifact.put_row("covered_map", row, layers[1:])
        if reader and not annotated.any():
            raise UserError(
                f"{recording_path}: none of the {len(indices)} evaluation frames is annotated. If the annotations cover a part "
                "of it, take that part (frames.start_s, frames.end_s), or raise frames.evaluation_frames."
            )
        artifact.put("frame", indices)
        artifact.put("annotated", annotated)
        artifact.facts = {"instances": [asdict(instance) for instance in reader.instances] if reader else []}
    missing = ", ".join(map(str, indices[~annotated]))
    lacking = f"; not annotated (indices from 0): {missing}" if missing else ""
    log(f"{annotated.sum()} of {len(indices)} evaluation frames are annotated{lacking}")


def _keys(facts: dict[str, Any], timestamp_ns: Ints) -> AnnotationKeys:
    lenses, pinhole = [Lens.of_facts(lens) for lens in facts.get("lenses", ())], facts.get("pinhole")
    lens_of = zip(timestamp_ns.tolist(), facts["lens_of_frame"], strict=True) if lenses else ()
    return AnnotationKeys(
        Camera(**facts["camera"]),
        facts["upright"],
        facts.get("known_poses"),
        facts.get("turned", True),
        {time: lenses[index] for time, index in lens_of},
        Camera(**pinhole) if pinhole else None,
    )
