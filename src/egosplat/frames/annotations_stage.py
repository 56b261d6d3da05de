"""Stage ``annotations``: instance maps of the evaluation frames. For evaluation only."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.frames.annotation_readers import open_annotations
from egosplat.geometry import Camera
from egosplat.progress import log, track


@dataclass(frozen=True)
class AnnotationsOptions:
    """The schema's key of ``annotations``; ``config.schema.yaml`` describes it."""

    max_age_ms: float


def run(recording: Path, frames: Path, output: Path, options: AnnotationsOptions) -> None:
    """Write the annotations artifact of the evaluation frames of ``frames``.

    A recording without annotations gives an artifact with no instances and no annotated frame.

    Raises:
        UserError: an annotation is damaged or does not fit the pictures, or there are some, and none of these frames.
    """
    source = open_artifact(frames, FRAMES)
    indices = np.flatnonzero(source.read("evaluation")).astype(np.int64)
    times = source.read("timestamp_ns")[indices]
    camera = Camera(**source.facts["camera"])
    reader = open_annotations(
        source.facts["format"],
        recording,
        camera=camera,
        upright=source.facts["upright"],
        max_age_ns=round(options.max_age_ms * 1e6),
    )
    made = provenance.begin_from("annotations", asdict(options), [source])
    annotated = np.zeros(len(indices), bool)
    with create(output, ANNOTATIONS, made) as artifact:
        artifact.allocate("instance_map", (len(indices), camera.height, camera.width))
        for row, time in enumerate(track(times, "reading annotations", total=len(times))):
            found = reader.instance_map(int(time)) if reader else None
            annotated[row] = found is not None
            nothing = np.full((camera.height, camera.width), -1, np.int32)
            artifact.put_row("instance_map", row, nothing if found is None else found)
        if reader and not annotated.any():
            raise UserError(
                f"{recording}: its annotations have none of the {len(indices)} evaluation frames. "
                "Are they of the same recording, and is frames.evaluation_frames more than a few?"
            )
        artifact.put("frame", indices)
        artifact.put("annotated", annotated)
        artifact.facts = {"instances": [asdict(instance) for instance in reader.instances] if reader else []}
    log(_summary(indices, annotated))


def _summary(frames: NDArray[np.int64], annotated: NDArray[np.bool_]) -> str:
    """How many evaluation frames are annotated, and which are not, by their numbers."""
    told = f"{annotated.sum()} of {len(frames)} evaluation frames are annotated"
    missing = ", ".join(map(str, frames[~annotated]))
    return f"{told}; without annotation, of the frames in use counted from 0: {missing}" if missing else told
