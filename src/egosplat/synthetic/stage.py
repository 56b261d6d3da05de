"""Stage ``synthetic``: a synthetic apartment's recording, in ADT's on-disk format."""

from dataclasses import asdict, dataclass
from pathlib import Path

from egosplat.synthetic.adt_format.adt import write_sequence
from egosplat.synthetic.recording import make_sequence


@dataclass(frozen=True)
class SyntheticOptions:
    """The schema's keys of ``synthetic``; ``config.schema.yaml`` describes each."""

    seed: int
    size: int
    fps: float
    seconds: float
    objects: int
    motion: float


def run(output: Path, options: SyntheticOptions) -> None:
    """Write the recording's folder at ``output``."""
    sequence = make_sequence(name=f"synthetic_apartment_seed{options.seed}", **asdict(options))
    write_sequence(sequence, output)
