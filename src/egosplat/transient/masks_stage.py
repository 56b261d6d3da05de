"""Stage ``masks``, the paper's spatial-temporal refinement stage: mask the transient instances (its set D) in each frame."""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from egosplat.arrays import Array, Bools, Ints, Ints32
from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import (
    BY_INSTANCES,
    BY_NETWORK,
    FRAMES,
    INSTANCES,
    MASKS,
    TRANSIENT,
    is_track,
    shown_pixels,
)
from egosplat.artifacts.writer import Writer, create
from egosplat.moving_regions import InstanceScores
from egosplat.progress import log, track
from egosplat.transient.options import MasksOptions
from egosplat.transient.sure_regions import Look, RegionMasks, find_regions, lasting_masks

# Least share of a transient instance's pixels that stand out (docs/method.md#stands-out). 0.3 to 0.55 work equally well, but where
# arms are always in view, 0.5 masks a quarter of the moving pixels and 0.35 two thirds.
LEAST_OUTSTANDING = 0.35

# Probability from which a pixel of a transient instance is masked, and from which a pixel moves without one.
PIXEL_PROBABILITY, SURE_PROBABILITY = 0.5, 0.9

# Mean probability, or share of transient instances, above which nothing is masked: poses, exposure or blur look like motion.
MAX_SHARE = 0.5

# An instance that is merged of fewer masks may be of something that moves.
_MASKS_THAT_HOLD = 3


def transient_instances(scores: Array, pixels: Ints, threshold: float) -> Bools:
    """(N,) the set D: instances of all levels with at least one pixel and a score of at least ``threshold``."""
    # An instance without pixels has the score 0, which reaches a threshold of 0.
    return np.asarray(scores >= threshold) & (pixels > 0)


def looks_static(outstanding: InstanceScores, least: float) -> Bools:
    """(N,) whether less than the share ``least`` of an instance's pixels stand out; False if none was measured."""
    return np.asarray(outstanding.scores < least) & (outstanding.pixels > 0)


def refined_mask(labels: Ints32, transient: Bools) -> Bools:
    """(H, W) union of the transient instances in one frame, from (L, H, W) labels and the (N,) set."""
    # Label -1 indexes the appended last entry: pixels without an instance are not transient.
    return np.asarray(np.append(transient, False)[labels].any(axis=0))


def run(
    frames_path: Path, transient_path: Path, instances_path: Path, output: Path, options: MasksOptions
) -> None:
    """Write the refined masks of all frames; UserError if the inputs do not belong together."""
    inputs = _Inputs(
        open_artifact(frames_path, FRAMES),
        open_artifact(transient_path, TRANSIENT),
        open_artifact(instances_path, INSTANCES),
    )
    frames, transient, instances = inputs
    for artifact in (transient, instances):
        check_made_from(artifact, frames, axes=("frame", "height", "width"))
    record = provenance.begin_from("masks", options.as_dict(), inputs)
    # Training frames alone decide: evaluation frames must not influence training.
    rows = np.flatnonzero(frames.read("train"))
    by_probability, outstanding, mean_probability = _score(inputs, rows)
    tracks = is_track(instances)
    scores, pixels = by_probability.scores, by_probability.pixels
    called = transient_instances(scores, pixels, options.threshold)
    guarded = options.recipe == "own"
    static = looks_static(outstanding, LEAST_OUTSTANDING if guarded else 0)
    chosen, seen = called & ~static, int((pixels > 0).sum())
    withheld, many = None, int(chosen.sum())
    if guarded and mean_probability > MAX_SHARE:
        withheld = BY_NETWORK
    elif guarded and many > MAX_SHARE * seen:
        withheld = BY_INSTANCES
    if withheld:
        log(
            f"nothing is masked: {many} of {seen} instances would be transient, "
            f"and the mean probability is {mean_probability:.2f}"
        )
    # Masks that are merged cover the same surfaces in several views: they stand still.
    chosen &= tracks & (withheld is None)
    merged = instances.read("instances/masks") >= _MASKS_THAT_HOLD
    look = _region_finder(inputs, np.where(tracks, called & static, merged), called)
    regions = lasting_masks(look, rows.tolist() if guarded and not withheld else [])
    with create(output, MASKS, record) as artifact:
        artifact.put("instances/score", scores.astype(np.float32))
        artifact.put("instances/stands_out", outstanding.scores.astype(np.float32))
        artifact.put("instances/transient", chosen)
        share, by_regions = _put_refined(artifact, inputs, chosen, regions, guarded)
        artifact.facts = {
            "threshold": options.threshold,
            "levels": instances.facts["levels"],
            "transient": int(chosen.sum()),
            "masked_share": share,
            "masked_by_regions": by_regions,
            "instances": len(chosen),
            "seen": seen,
            "empty": int((pixels == 0).sum()),
            "mean_probability": mean_probability,
            "withheld": withheld,
            "withheld_instances": many if withheld else 0,
        }
    log(
        f"{int(chosen.sum())} of {len(chosen)} instances are transient: {share:.1%} of all pixels are masked, "
        f"{by_regions:.1%} because the network is sure of them without an instance"
    )


class _Inputs(NamedTuple):
    frames: Artifact
    transient: Artifact
    instances: Artifact

    def labels(self, frame: int) -> Ints32:
        """(L, H, W) instances of a frame; -1 where its own mask leaves the pixel out: it says nothing of an instance."""
        labels = self.instances.row("labels", frame)
        return np.where(shown_pixels(self.frames, frame, labels >= 0), labels, np.int32(-1))


def _score(inputs: _Inputs, rows: Ints) -> tuple[InstanceScores, InstanceScores, float]:
    """Score the instances on the frames ``rows``: by probability, and by what stands out; and the mean probability."""
    frames, transient, instances = inputs
    count = instances.shape("instances/level")[0]
    by_probability, outstanding, total = InstanceScores(count), InstanceScores(count), 0.0
    measured, compared = np.isfinite(transient.read("residual_scale")), transient.read("compared")
    for frame in track(rows, "scoring instances", total=len(rows)):
        labels, probability = inputs.labels(frame), transient.row("probability", frame)
        by_probability.add(labels, probability)
        shown = probability[shown_pixels(frames, frame, np.ones(probability.shape, bool))]
        total += float(shown.mean(dtype=np.float64)) if shown.size else 0.0
        if measured[frame]:
            outstanding.add(np.where(compared, labels, -1), transient.row("stands_out", frame))
    return by_probability, outstanding, total / max(len(rows), 1)


def _region_finder(inputs: _Inputs, still: Bools, called: Bools) -> Look:
    """Find regions; where the network errs about a ``still`` one of the ``called`` instances, it is not sure of anything."""
    frames, transient, _ = inputs
    measured, compared = np.isfinite(transient.read("residual_scale")), transient.read("compared")

    # A frame is compared with the two before it, which stay while it comes.
    @lru_cache(4)
    def look(frame: int) -> Ints32:
        labels = inputs.labels(frame)
        sure = (transient.row("probability", frame) >= SURE_PROBABILITY) & compared
        sure = shown_pixels(frames, frame, sure) & ~refined_mask(labels, still & called)
        outstanding = transient.row("stands_out", frame) if measured[frame] else None
        return find_regions(sure, refined_mask(labels, still), outstanding)

    return look


def _put_refined(
    artifact: Writer, inputs: _Inputs, chosen: Bools, regions: RegionMasks, guarded: bool
) -> tuple[float, float]:
    """Write the masks of all frames; returns the share of all pixels that are masked, and that regions alone mask."""
    count, height, width = inputs.transient.shape("probability")
    artifact.allocate("refined", (count, height, width))
    masked, by_instances = 0, 0
    for frame in track(range(count), "writing masks"):
        probability = inputs.transient.row("probability", frame)
        marked = probability >= (PIXEL_PROBABILITY if guarded else 0)
        mask = refined_mask(inputs.labels(frame), chosen) & marked
        by_instances += int(mask.sum())
        if guarded:
            sure = probability >= SURE_PROBABILITY
            mask |= shown_pixels(inputs.frames, frame, regions.mask(frame, sure, marked))
        masked += int(mask.sum())
        artifact.put_row("refined", frame, mask)
    every = max(count * height * width, 1)
    return masked / every, (masked - by_instances) / every
