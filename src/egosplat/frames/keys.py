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
        lenses = [Lens.of_facts(lens) for lens in facts.get("lenses", ())]
        of_frame = zip(timestamp_ns.tolist(), facts.get("lens_of_frame", ()), strict=bool(lenses))
        pinhole = facts.get("pinhole")
        return cls(
            facts.get("known_poses"),
            facts.get("turned", True),
            {time: lenses[index] for time, index in of_frame} if lenses else {},
            Camera(**pinhole) if pinhole else None,
        )


@dataclass(frozen=True)
class AnnotationKeys:
    """How annotations are read from a recording.

    Attributes:
        camera, upright: of the frames, as in ``Capture``.
        max_age_ns: largest time between a frame and its annotation; pictures are annotated by name.
        originals: of pictures: how they became the frames.
    """

    camera: Camera
    upright: bool = True
    max_age_ns: int = 3_000_000
    originals: Originals = field(default_factory=Originals)
