"""How the readers of a format read frames and annotations."""

from dataclasses import dataclass
from typing import Any

from egosplat.calibration.lens import Lens
from egosplat.geometry import Camera


@dataclass(frozen=True)
class ReaderKeys:
    """How frames are read from a recording; see ``egosplat.frames.readers.open_recording``."""

    resolution: int
    focal: float
    upright: bool
    stride: int
    start_s: float
    end_s: float | None
    known_poses: str
    lens: str
    pick: str

    @property
    def selection(self) -> dict[str, Any]:
        """The keys that every format takes."""
        return {key: getattr(self, key) for key in ("resolution", "stride", "start_s", "end_s")}


@dataclass(frozen=True)
class AnnotationKeys:
    """How annotations are read from a recording; see ``egosplat.frames.annotations_stage.open_annotations``."""

    camera: Camera
    upright: bool
    max_age_ns: int
    lens: Lens | None
