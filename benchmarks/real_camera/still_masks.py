"""What is masked in scenes in which nothing moves, with masks forced.

snakemake --cores 2 --configfile benchmarks/real_camera/config.yaml --config splats='{masking: refined}' -- \\
    results/real_camera/{poses,exposure,shutter,sensor,all}_{half,once,twice,4times}_still/masks.zarr
python -m benchmarks.real_camera.still_masks results/real_camera/*_still
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.common import command, markdown, scene_folders, survey_of
from egosplat.artifacts.lineage import locate
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import MASKS, TRANSIENT
from egosplat.pipeline.home import title_of
from egosplat.pipeline.validation import read_document

COLUMNS = ("scene", "share that moves", "mean transient probability", "instances masked", "pixels masked")


def row(folder: Path) -> list[object]:
    """A row of the table: the survey, the network, and the masks of a still scene."""
    masks, transient = map(open_artifact, locate(folder, "masks", "transient"), (MASKS, TRANSIENT))
    count = masks.shape("refined")[0]
    share = float(np.mean([masks.row("refined", frame).mean() for frame in range(count)]))
    moving = masks.read("instances/transient")
    survey = read_document(survey_of(folder) or folder / "survey.json", "survey")["motion"]["share"]
    return [
        title_of(folder),
        "cannot tell" if survey is None else f"{survey:.3%}",
        f"{transient.facts['mean_probability']:.3f}",
        f"{int(moving.sum())} of {len(moving)}",
        f"{share:.2%}",
    ]


@command(__doc__)
@scene_folders
def main(folders: Sequence[Path]) -> None:
    print(markdown(COLUMNS, [row(folder) for folder in folders]))


if __name__ == "__main__":
    main()
