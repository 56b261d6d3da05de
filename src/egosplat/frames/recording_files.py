"""Facts about a recording that its file names tell: companion files, annotations."""

import os
from pathlib import Path

from egosplat.calibration.companions import companion_path

# Folder with the annotations of a plain recording.
ANNOTATIONS = "annotations"

# Of an ADT sequence, in order of preference: releases without people's masks have the second.
ADT_SEGMENTATIONS = ("segmentations_with_skeleton.vrs", "segmentations.vrs")


def is_annotated(format: str, path: Path) -> bool:
    """Whether a recording comes with annotations, judged without reading them.

    HOI4D, LERF-OVS and 3D-OVS do. An ADT recording does if it has a segmentation, which other recordings of Aria glasses have not;
    one that does not exist yet is a synthetic one. A plain recording does if its annotations folder exists.
    """
    if format == "adt":
        return find_segmentation(path) is not None or not path.is_dir()
    # A broken link counts as present: the annotations stage then reports it.
    return format != "plain" or os.path.lexists(companion_path(path, ANNOTATIONS))


def find_segmentation(folder: Path) -> Path | None:
    """The segmentation of an ADT sequence, preferably the one with people; None if there is none."""
    candidates = [folder / name for name in ADT_SEGMENTATIONS]
    # A broken link is not a missing file: opening it reports the error.
    return next((path for path in candidates if os.path.lexists(path)), None)
