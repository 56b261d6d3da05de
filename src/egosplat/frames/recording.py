"""A recording as importers return it, one a format: its frames, and separately its annotations, which training never reads."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from egosplat.arrays import Array, Bools, Bytes, Ints, Ints32
from egosplat.calibration.files import Origin
from egosplat.calibration.lens import Lens, Rectifier
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.images import resize_labels


@dataclass(frozen=True)
class Recording:
    """The rectified frames of a recording, and what is known of them before any is decoded.

    Attributes:
        timestamp_ns, exposure_middle_ns: (F,) int64, strictly increasing: capture time of each frame (video: since its start),
            and the middle of its exposure; poses are of this time.
        camera_known: True for a calibration, False for a guessed field of view.
        valid: (H, W) bool: pixels that show the scene (inside the lens circle).
        read_frames: yields the (H, W, 3) uint8 RGB frame of each of increasing indices, 0 outside ``valid``.
        device_from_camera: (4, 4) float64, or None if the recording has no device frame.
        upright: whether up in the frames is up in the world, as far as the recording tells.
        labeled: (E,) int64 frames whose labels a benchmark scores; None if any frame may be held out.
        masked: returns the (H, W) bool pixels that a frame's own mask or transparency leaves out; None if no frame has any.
        facts: further facts about a plain recording, as plain JSON.
    """

    timestamp_ns: Ints
    exposure_middle_ns: Ints
    camera: Camera
    camera_known: bool
    valid: Bools
    read_frames: Callable[[Ints], Iterator[Bytes]]
    device_from_camera: Array | None = None
    origin: Origin = "real"
    upright: bool = True
    labeled: Ints | None = None
    masked: Callable[[int], Bools] | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Instance:
    """One annotated instance.

    Attributes:
        id, name: the dataset's.
        category: the phrase of its query, for example ``"step stool"``.
        motion_type: the dataset's label; people are dynamic.
    """

    id: int
    name: str
    category: str
    motion_type: Literal["static", "dynamic"]
    instance_type: Literal["object", "human"]


def check_instance(where: str, entry: Mapping[str, Any], fields: Sequence[str], largest: int) -> Instance:
    """Make an instance of an entry's fields, in the order of ``Instance``; UserError, of ``where``, if a value is not possible."""
    identity, name, category, motion, kind = (entry[field] for field in fields)
    if not isinstance(identity, int) or not 0 < identity <= largest:
        raise UserError(f"{where}: {fields[0]} is {identity!r:.40}, not a whole number from 1 to {largest}.")
    if motion not in ("static", "dynamic"):
        raise UserError(f"{where}: {fields[3]} is {motion!r:.40}, not static or dynamic.")
    if kind not in ("object", "human"):
        raise UserError(f"{where}: {fields[4]} is {kind!r:.40}, not object or human.")
    return Instance(identity, str(name), str(category), motion, kind)


@dataclass(frozen=True, eq=False)
class Annotations:
    """The annotations of a recording, in the pixels of its rectified frames.

    Attributes:
        read: returns (L, H, W) int32 indices into ``instances`` of the frame captured at a time [ns], -1 for none: the instance
            map, then layers with the instances that it shows in part, whole. None if the frame is not annotated.
        covered: largest number of layers beside the instance map.
    """

    instances: list[Instance]
    read: Callable[[int], Ints32 | None]
    covered: int = 0


# Largest time between a frame and its annotation [ns]: EgoLifter's (docs/method.md#annotation-age). Pictures are annotated by name.
MAX_AGE_NS = 3_000_000


@dataclass(frozen=True)
class AnnotationKeys:
    """How annotations are read.

    Attributes:
        camera, upright: of the frames, as in ``Recording``.
        known_poses, turned: of pictures: the kind of their known poses, and whether EXIF orientation was applied.
        lenses: of pictures that are rectified: the lens of each frame, by its time.
        pinhole: camera of the rectified full-size pictures; None if they are not rectified.
    """

    camera: Camera
    upright: bool = True
    known_poses: str | None = None
    turned: bool = True
    lenses: Mapping[int, Lens] = field(default_factory=dict)
    pinhole: Camera | None = None

    def fit(self, labels: Ints32, time: int) -> Ints32:
        """Rectify and resize (h, w) labels of a picture to its frame at ``time`` [ns], (H, W)."""
        if lens := self.lenses.get(time):
            labels = Rectifier(lens, self.pinhole).labels(labels)
        return np.asarray(resize_labels(labels, self.camera.width, self.camera.height), np.int32)
