"""What a reader offers: a recording's pictures, rectified to a pinhole, and its annotations.

``Recording`` is all that training may see. ``Annotations`` is for evaluation only and is kept in modules
of its own (``*_annotations.py``), so that no training stage reaches them, not even through code.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Camera

Origin = Literal["real", "synthetic"]


@dataclass(frozen=True)
class Capture:
    """What is known of a recording before a picture is decoded; all of it after rectification.

    Attributes:
        timestamp_ns: (F,) int64, strictly increasing: when each picture was captured (video: from its start).
        exposure_middle_ns: (F,) int64: when the middle of the picture was exposed; poses belong to this moment.
        camera: the pinhole camera of every picture.
        camera_known: whether ``camera`` is a calibration, not a guess from the field of view.
        device_from_camera: (4, 4) float64, or None where the recording has no device frame.
        valid: (H, W) bool: pixels that show the scene (inside the lens circle, after rectification).
        origin: ``real`` or ``synthetic``.
        upright: whether up in the pictures is up in the world, as far as the recording tells.
    """

    timestamp_ns: NDArray[np.int64]
    exposure_middle_ns: NDArray[np.int64]
    camera: Camera
    camera_known: bool
    device_from_camera: NDArray[np.float64] | None
    valid: NDArray[np.bool_]
    origin: Origin
    upright: bool = True

    @classmethod
    def of_video(
        cls, timestamp_ns: NDArray[np.int64], camera: Camera, camera_known: bool, valid: NDArray[np.bool_]
    ) -> "Capture":
        """What is known of a real recording by a camera alone: exposed when it is stamped, no device frame."""
        return cls(timestamp_ns, timestamp_ns, camera, camera_known, None, valid, "real")


class Recording(Protocol):
    """A recording's pictures."""

    @property
    def capture(self) -> Capture: ...

    def pictures(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB picture of each index, in the given (increasing) order.

        Pixels outside ``capture.valid`` are 0.
        """
        ...


@dataclass(frozen=True)
class Instance:
    """One annotated thing.

    Attributes:
        id: the dataset's own id.
        name: the dataset's own name of this instance.
        category: what a query asks for, for example ``"step stool"``.
        motion_type: ``static`` or ``dynamic``, as the dataset labels it; people are dynamic.
        instance_type: ``object`` or ``human``.
    """

    id: int
    name: str
    category: str
    motion_type: Literal["static", "dynamic"]
    instance_type: Literal["object", "human"]


class Annotations(Protocol):
    """A recording's annotations, in the geometry of its rectified pictures."""

    @property
    def instances(self) -> list[Instance]: ...

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """The instances of the picture captured at ``timestamp_ns``, or None where it has no annotation.

        Returns:
            (H, W) int32: index into ``instances``; -1 where nothing is annotated (outside the lens circle).
        """
        ...
