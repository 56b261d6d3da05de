"""Stage ``synthetic``: a synthetic apartment's recording, in ADT's on-disk format."""

from pathlib import Path

from egosplat.synthetic.adt_format.adt import write_sequence
from egosplat.synthetic.recording import make_sequence


def run(
    output: Path, *, seed: int, size: int, fps: float, seconds: float, objects: int, motion: float
) -> None:
    """Write the recording's folder at ``output``; the keys are those of the schema's ``synthetic``."""
    sequence = make_sequence(
        name=f"synthetic_apartment_seed{seed}",
        seed=seed,
        size=size,
        fps=fps,
        seconds=seconds,
        objects=objects,
        motion=motion,
    )
    write_sequence(sequence, output)
