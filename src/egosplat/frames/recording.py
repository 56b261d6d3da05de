"""A recording as importers return it, one a format: its frames, and separately its annotations, which training never reads."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import Origin
from egosplat.geometry import Camera


@dataclass(frozen=True)
class Recording:
    """The rectified frames of a recording, and what is known of them before any is decoded.

    Attributes:
        timestamp_ns: (F,) int64, strictly increasing: capture time of each frame (video: since its start).
        exposure_middle_ns: (F,) int64: middle of each exposure; poses are of this time.
        camera_known: True for a calibration, False for a guessed field of view.
        valid: (H, W) bool: pixels that show the scene (inside the lens circle).
        read_frames: yields the (H, W, 3) uint8 RGB frame of each of increasing indices, 0 outside ``valid``.
        device_from_camera: (4, 4) float64, or None if the recording has no device frame.
        origin: ``real`` or ``synthetic``.
        upright: whether up in the frames is up in the world, as far as the recording tells.
        labeled: (E,) int64 frames whose labels a benchmark scores; None if any frame may be held out.
        masked: returns the (H, W) bool pixels of a frame that its own mask or transparency leaves out; None if no frame has any.
        facts: further facts about a plain recording, as plain JSON, for the frames artifact.
    """

    timestamp_ns: NDArray[np.int64]
    exposure_middle_ns: NDArray[np.int64]
    camera: Camera
    camera_known: bool
    valid: NDArray[np.bool_]
    read_frames: Callable[[NDArray[np.int64]], Iterator[NDArray[np.uint8]]]
    device_from_camera: NDArray[np.float64] | None = None
    origin: Origin = "real"
    upright: bool = True
    labeled: NDArray[np.int64] | None = None
    masked: Callable[[int], NDArray[np.bool_]] | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Instance:
    """One annotated instance.

    Attributes:
        id, name: the dataset's.
        category: the phrase of its query, for example ``"step stool"``.
        motion_type: the dataset's label ``static`` or ``dynamic``; people are dynamic.
        instance_type: ``object`` or ``human``.
    """

    id: int
    name: str
    category: str
    motion_type: Literal["static", "dynamic"]
    instance_type: Literal["object", "human"]


class Annotations(Protocol):
    """The annotations of a recording, in the pixels of its rectified frames."""

    @property
    def instances(self) -> list[Instance]: ...

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """(H, W) int32 index into ``instances`` of the frame captured then, -1 for none; None if it is not annotated."""
        ...


@dataclass(frozen=True, eq=False)
class LayeredAnnotations:
    """Annotations of a few frames whose instances may overlap; an ``Annotations``.

    Attributes:
        layers: (L, H, W) int32 of each annotated frame, by its time: the instance map, then further ones with the instances
            that it shows in part, whole.
    """

    instances: list[Instance]
    layers: Mapping[int, NDArray[np.int32]]

    @property
    def covered(self) -> int:
        """Number of layers beside the instance map."""
        return max(len(layers) for layers in self.layers.values()) - 1

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """See ``Annotations.instance_map``."""
        layers = self.layers.get(int(timestamp_ns))
        return None if layers is None else layers[0]

    def covered_map(self, timestamp_ns: int) -> NDArray[np.int32]:
        """(covered, H, W) int32: the layers beside the instance map of an annotated frame; -1 for none."""
        beside = self.layers[int(timestamp_ns)][1:]
        return np.pad(beside, [(0, self.covered - len(beside)), (0, 0), (0, 0)], constant_values=-1)
