"""Stage ``masks``: select the transient instances (the paper's set D) and mask their pixels in each frame."""

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
    """Configuration keys of the stage; ``config.schema.yaml`` describes each."""

    threshold: float
    level: str


def run(frames: Path, transient: Path, segments: Path, output: Path, options: MasksOptions) -> None:
    """Write the refined masks of all frames.

    Raises:
        UserError: the inputs do not belong together.
    """
    threshold, level = options.threshold, options.level
    frames_artifact = open_artifact(frames, FRAMES)
    transient_artifact, segments_artifact = (
        open_artifact(transient, TRANSIENT),
        open_artifact(segments, SEGMENTS),
    )
    for artifact in (transient_artifact, segments_artifact):
        check_made_from(artifact, frames_artifact, axes=("frame", "height", "width"))
    record = provenance.begin_from(
        "masks", asdict(options), (frames_artifact, transient_artifact, segments_artifact)
    )
    names = segments_artifact.facts["levels"]
    shown_by = segments_artifact.facts.get("repeats", {}).get(level, level)
    levels = set(range(len(names))) if level == "all" else {names.index(shown_by)}
    # Training frames alone decide: evaluation frames must not influence training.
    found = _scores(transient_artifact, segments_artifact, np.flatnonzero(frames_artifact.read("train")))
    scores = found.scores
    chosen = transient_instances(
        scores, found.pixels, segments_artifact.read("instances/level"), threshold, levels
    )
    count, height, width = transient_artifact.shape("probability")
    masked = 0
    with create(output, MASKS, record) as artifact:
        artifact.put("instances/score", scores.astype(np.float32))
        artifact.put("instances/transient", chosen)
        artifact.allocate("refined", (count, height, width))
        for frame in track(range(count), "writing masks"):
            mask = refined_mask(segments_artifact.row("labels", frame), chosen)
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


def _scores(transient: Artifact, segments: Artifact, rows: NDArray[np.int64]) -> InstanceScores:
    """Score the instances on the frames ``rows``."""
    scores = InstanceScores(segments.shape("instances/level")[0])
    for frame in track(rows, "scoring instances", total=len(rows)):
        scores.add(segments.row("labels", frame), transient.row("probability", frame))
    return scores
