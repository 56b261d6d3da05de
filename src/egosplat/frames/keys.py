"""How annotations are read from a recording."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.lens import Lens
from egosplat.geometry import Camera


@dataclass(frozen=True)
class Originals:
    """How the pictures of a plain recording became its frames.

    Attributes:
        known_poses: kind of the known poses, or None.
        turned: whether EXIF orientation was applied.
        lenses: the lens of each frame, by its time; empty if they are not rectified.
        pinhole: camera of the rectified full-size pictures; None if they are not rectified.
    """

    known_poses: str | None = None
    turned: bool = True
    lenses: Mapping[int, Lens] = field(default_factory=dict)
    pinhole: Camera | None = None

    @classmethod
    def of_facts(cls, facts: Mapping[str, Any], timestamp_ns: NDArray[np.int64]) -> "Originals":
        """Those that frames.zarr tells of its (F,) frames; of a recording that is not plain it tells nothing."""
        lenses, pinhole = [Lens.of_facts(lens) for lens in facts.get("lenses", ())], facts.get("pinhole")
        index_of = dict(zip(timestamp_ns.tolist(), facts["lens_of_frame"], strict=True)) if lenses else {}
        return cls(
            facts.get("known_poses"),
            facts.get("turned", True),
            {time: lenses[index] for time, index in index_of.items()},
            Camera(**pinhole) if pinhole else None,
        )


@dataclass(frozen=True)
class AnnotationKeys:
    """How annotations are read.

    Attributes:
        camera, upright: of the frames, as in ``Recording``.
        max_age_ns: largest time between a frame and its annotation; pictures are annotated by name.
        originals: of pictures: how they became the frames.
    """

    camera: Camera
    upright: bool = True
    max_age_ns: int = 3_000_000
    originals: Originals = field(default_factory=Originals)
