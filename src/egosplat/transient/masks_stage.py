"""Stage ``masks``: which instances are transient, and their pixels in each frame."""

from pathlib import Path
from typing import Any

import numpy as np

from egosplat import provenance
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.reading import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.transient import TRANSIENT
from egosplat.artifacts.writing import create
from egosplat.errors import UserError
from egosplat.progress import log, track
from egosplat.transient.refinement import InstanceScores, refined_mask, transient_instances


def run(transient: Path, segments: Path, output: Path, *, threshold: float, level: str) -> None:
    """Write the refined masks; the keys are those of the schema's ``masks``.

    Raises:
        UserError: the inputs do not belong together.
    """
    keys: dict[str, Any] = {"threshold": threshold, "level": level}
    predicted, instances = open_artifact(transient, TRANSIENT), open_artifact(segments, SEGMENTS)
    _check_belong_together(predicted, instances)
    made = provenance.begin_from("masks", keys, (predicted, instances))
    names = instances.facts["levels"]
    shown_by = instances.facts.get("repeats", {}).get(level, level)
    levels = set(range(len(names))) if level == "all" else {names.index(shown_by)}
    found = _scores(predicted, instances)
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


def _scores(predicted: Artifact, instances: Artifact) -> InstanceScores:
    scores = InstanceScores(instances.shape("instances/level")[0])
    for frame in track(range(predicted.shape("probability")[0]), "scoring instances"):
        scores.add(instances.row("labels", frame), predicted.row("probability", frame))
    return scores


def _check_belong_together(predicted: Artifact, instances: Artifact) -> None:
    """Check that both are of the same frames.

    Raises:
        UserError: they are not.
    """
    frames, _, *size = instances.shape("labels")
    sources = [artifact.provenance["inputs"].get("frames.zarr") for artifact in (predicted, instances)]
    differ = None not in sources and sources[0] != sources[1]
    if differ or predicted.shape("probability") != (frames, *size):
        raise UserError(
            f"{instances.path}: was made from other frames than {predicted.path}; make both anew: "
            f"snakemake --cores 2 {predicted.path} {instances.path}"
        )
