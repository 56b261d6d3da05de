"""Stage ``masks``: select the transient instances (the paper's set D) and mask their pixels in each frame."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.transient import TRANSIENT, InstanceScores
from egosplat.artifacts.writer import create
from egosplat.progress import log, track

Scores = NDArray[np.float64]


def transient_instances(
    scores: Scores, pixels: NDArray[np.int64], level: NDArray[np.int8], threshold: float, levels: set[int]
) -> NDArray[np.bool_]:
    """(N,) the set D: instances of ``levels`` with at least one pixel and a score of at least ``threshold``."""
    # An instance without pixels has the score 0, which reaches a threshold of 0.
    return (scores >= threshold) & (pixels > 0) & np.isin(level, sorted(levels))


def refined_mask(labels: NDArray[np.int32], transient: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) union of the transient instances in one frame, from (L, H, W) labels and the (N,) set."""
    # Label -1 indexes the appended last entry: pixels without an instance are not transient.
    return np.append(transient, False)[labels].any(axis=0)


@dataclass(frozen=True)
class MasksOptions:
    """Configuration keys of the stage; ``config.schema.yaml`` describes each."""

    threshold: float
    level: str


def run(
    frames_path: Path, transient_path: Path, instances_path: Path, output: Path, options: MasksOptions
) -> None:
    """Write the refined masks of all frames.

    Raises:
        UserError: the inputs do not belong together.
    """
    threshold, level = options.threshold, options.level
    frames = open_artifact(frames_path, FRAMES)
    transient, instances = (
        open_artifact(transient_path, TRANSIENT),
        open_artifact(instances_path, INSTANCES),
    )
    for artifact in (transient, instances):
        check_made_from(artifact, frames, axes=("frame", "height", "width"))
    record = provenance.begin_from("masks", asdict(options), (frames, transient, instances))
    names = instances.facts["levels"]
    # A level that repeats another has no instances of its own; the other level stands for it.
    shown_by = instances.facts.get("repeats", {}).get(level, level)
    levels = set(range(len(names))) if level == "all" else {names.index(shown_by)}
    # Training frames alone decide: evaluation frames must not influence training.
    found = _scores(transient, instances, np.flatnonzero(frames.read("train")))
    scores = found.scores
    chosen = transient_instances(scores, found.pixels, instances.read("instances/level"), threshold, levels)
    count, height, width = transient.shape("probability")
    masked = 0
    with create(output, MASKS, record) as artifact:
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


def _scores(transient: Artifact, instances: Artifact, rows: NDArray[np.int64]) -> InstanceScores:
    """Score the instances on the frames ``rows``."""
    scores = InstanceScores(instances.shape("instances/level")[0])
    for frame in track(rows, "scoring instances", total=len(rows)):
        scores.add(instances.row("labels", frame), transient.row("probability", frame))
    return scores
