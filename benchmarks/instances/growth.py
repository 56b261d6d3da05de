"""Time and memory of merging masks against frames, masks and Gaussians, on masks that are made up.

    python -m benchmarks.instances.growth

A frame sees a fifth of the Gaussians, which stand in a ring. 60 instances are arcs of it. A frame has a mask of each that it
sees, whose ends are off by 5 %, and wrong masks: arcs of any place and length. Each size runs in a process of its own.
"""

import resource
from itertools import pairwise

import click
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from benchmarks.common import command, markdown, output_of, time_call
from egosplat.instances.lifted_masks import LiftedMasks
from egosplat.instances.things import find_things

INSTANCES = 60

# Frames, Gaussians, and wrong masks of a frame.
SIZES = [(frames, 60_000, 5) for frames in (60, 120, 240, 480, 960)]
SIZES += [(120, 60_000, 0), (120, 60_000, 17), (120, 15_000, 5), (120, 240_000, 5)]
COLUMNS = ("frames", "Gaussians", "masks", "runs that stay", "instances", "CPU-s", "peak MiB")


def made_up_masks(frames: int, gaussians: int, wrong: int) -> LiftedMasks:
    """Masks of single frames at one level."""
    rng = np.random.default_rng(0)
    inner = rng.choice(np.arange(1, gaussians), INSTANCES - 1, replace=False)
    edges = np.sort(np.concatenate([[0], inner, [gaussians]]))
    seen, rows = np.zeros((frames, gaussians), np.float32), np.arange(frames)
    members: list[NDArray[np.int64]] = []
    frame = []
    for now in range(frames):
        window = (rng.integers(gaussians) + np.arange(gaussians // 4)) % gaussians
        visible = np.zeros(gaussians, bool)
        visible[window] = True
        visible &= rng.uniform(size=gaussians) < 0.8
        seen[now, visible] = rng.uniform(0.3, 3.0, visible.sum())
        arcs = []
        for first, end in pairwise(edges):
            if visible[first:end].sum() >= 20:
                off = (rng.normal(size=2) * 0.05 * (end - first)).astype(int)
                arcs.append((max(0, first + off[0]), end + off[1]))
        for _ in range(wrong):
            length = int(np.exp(rng.uniform(np.log(100), np.log(gaussians / 20))))
            arcs.append((start := int(rng.choice(window)), start + length))
        held = [first + np.flatnonzero(visible[first:end]) for first, end in arcs]
        members += [one for one in held if len(one)]
        frame += [now] * sum(len(one) > 0 for one in held)
    weights = [seen[now, one] for now, one in zip(frame, members, strict=True)]
    starts = np.concatenate([[0], np.cumsum([len(one) for one in members])])
    columns = np.concatenate(weights), np.concatenate(members).astype(np.int32), starts
    votes = sparse.csc_array(columns, (gaussians, len(members)))
    return LiftedMasks(np.arange(len(members)), np.array(frame), rows, votes, sparse.csr_array(seen))


def row_of(frames: int, gaussians: int, wrong: int) -> list[str]:
    """A row of the table, in this process."""
    masks = made_up_masks(frames, gaussians, wrong)
    (_, counts), seconds = time_call(find_things, masks, masks.weight)
    stay = counts["things"] + counts["claimed"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    numbers = (frames, gaussians, counts["masks"], stay, counts["things"])
    return [*(f"{number:,}" for number in numbers), f"{seconds:.1f}", f"{peak:,.0f}"]


@command(__doc__)
@click.option("--one", type=int, nargs=3, hidden=True)
def main(one: tuple[int, int, int] | None) -> None:
    """Print the table, or a row of it."""
    if one:
        print("|".join(row_of(*one)))
        return
    rows = [output_of("benchmarks.instances.growth", "--one", *size).strip().split("|") for size in SIZES]
    print(markdown(COLUMNS, rows, words=0))


if __name__ == "__main__":
    main()
