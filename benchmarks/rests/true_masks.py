"""A scene's masks replaced by true ones, in the frames that SAM2 segmented."""

from pathlib import Path

import numpy as np

from benchmarks.transient.truth import read_truth
from egosplat.artifacts import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.writer import create
from egosplat.progress import track

# Smaller masks are left out, as SAM2's are: the default of segments.min_area.
LEAST_AREA = 0.0005


def write_true_masks(folder: Path, output: Path) -> None:
    """Write segments.zarr with the true masks of objects and people, each a mask of one frame, at the level ``whole``."""
    frames, own = open_artifact(folder / "frames.zarr", FRAMES), open_artifact(folder / "segments.zarr", SEGMENTS)
    truth, valid = read_truth((folder / "recording").resolve(), frames), frames.read("valid")
    chosen, shape = set(own.facts["key_frames"]), own.shape("labels")
    first, count = [], 0
    with create(output, SEGMENTS, provenance.begin_from("segments", {}, [frames])) as artifact:
        artifact.allocate("labels", (shape[0], 1, *shape[2:]))
        for frame, labels in enumerate(track(truth.all_labels(), "writing true masks", total=shape[0])):
            row = np.full((1, *shape[2:]), -1, np.int32)
            if frame in chosen:
                ids, areas = np.unique(labels[valid & (labels >= 0)], return_counts=True)
                for one in ids[areas >= LEAST_AREA * valid.size].tolist():
                    row[0, valid & (labels == one)] = count
                    first.append(frame)
                    count += 1
            artifact.put_row("labels", frame, row)
        artifact.put("instances/level", np.zeros(count, np.int8))
        for name in ("predicted_iou", "stability"):
            artifact.put(f"instances/{name}", np.ones(count, np.float32))
        artifact.put("instances/first_frame", np.array(first, np.int64))
        artifact.put("instances/moving", np.zeros(count, bool))
        artifact.facts = {"levels": ["whole"], "instances": {"whole": count}, "segmenter": "truth", "single_frames": True}
