"""Stage ``masks``: which instances are transient (the paper's set D), and their pixels in each frame."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.transient import TRANSIENT
from egosplat.artifacts.writer import create
from egosplat.progress import log, track
from egosplat.transient.refinement import InstanceScores, refined_mask, transient_instances


@dataclass(frozen=True)
class MasksOptions:
    """The schema's keys of ``masks``; ``config.schema.yaml`` describes each."""

    threshold: float
    level: str


def run(frames: Path, transient: Path, segments: Path, output: Path, options: MasksOptions) -> None:
    """Write the refined masks.

    Which instances are transient is decided by the training frames alone, as what evaluation frames show may decide
    nothing that is trained on. The instances that are found are masked in all frames.

    Raises:
        UserError: the inputs do not belong together.
    """
    threshold, level = options.threshold, options.level
    pictures = open_artifact(frames, FRAMES)
    predicted, instances = open_artifact(transient, TRANSIENT), open_artifact(segments, SEGMENTS)
    for artifact in (predicted, instances):
        check_made_from(artifact, pictures, axes=("frame", "height", "width"))
    made = provenance.begin_from("masks", asdict(options), (pictures, predicted, instances))
    names = instances.facts["levels"]
    shown_by = instances.facts.get("repeats", {}).get(level, level)
    levels = set(range(len(names))) if level == "all" else {names.index(shown_by)}
    found = _scores(predicted, instances, np.flatnonzero(pictures.read("train")))
    scores = found.scores
    chosen = transient_instances(scores, found.pixels, instances.read("instances/level"), threshold, levels)
    count, height, width = predicted.shape("probability")
    masked = 0
    with create(output, MASKS, made) as artifact:
        artifact.put("instances/score", scores.astype(np.float32))
        artifact.put("instances/transient", chosen)
        artifact.allocate("refined", (count, height, width))
        for frame in track(range(count), "writing masks"):
            mask = refined_mask(instances.row("labels", frame), chosen)
            masked += int(mask.sum())
            artifact.put_row("refined", frame, mask)
        share = masked / max(count * height * width, 1)
        artifact.facts = {
            "threshold": threshold,
            "level": level,
            "levels": names,
            "instances": len(chosen),
            "transient": int(chosen.sum()),
            "empty": int((found.pixels == 0).sum()),
            "masked_share": share,
        }
    log(f"{int(chosen.sum())} of {len(chosen)} instances are transient: {share:.1%} of all pixels")


def _scores(predicted: Artifact, instances: Artifact, rows: NDArray[np.int64]) -> InstanceScores:
    """The scores by the frames of ``rows``."""
    scores = InstanceScores(instances.shape("instances/level")[0])
    for frame in track(rows, "scoring instances", total=len(rows)):
        scores.add(instances.row("labels", frame), predicted.row("probability", frame))
    return scores
