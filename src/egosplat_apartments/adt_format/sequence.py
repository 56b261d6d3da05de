"""The content of a synthetic recording, before it is written in ADT's on-disk format.

World axes are ADT's: y up, gravity (0, -9.81, 0), meters. The device frame is Aria's (the left SLAM
camera). Images are in sensor orientation: rotate them clockwise by 90° to see them upright.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.arrays import Trajectory


@dataclass(frozen=True)
class Instance:
    """One entry of ADT's ``instances.json``.

    Attributes:
        instance_id: unique, positive; the value of its pixels in the segmentation images.
        name: unique, in ADT style (``"BlackCoaster_1"``).
        prototype: the kind of object, without number.
        category: one of ADT's category names (``"coaster"``); ``"person"`` for people.
        category_uid: one number per category.
        motion_type: ADT's label. A ``dynamic`` instance may stay still in a given recording.
        instance_type: ``human`` instances are absent from the files of scene objects and 3D boxes.
        bounds: (2, 3) float64 [m], lower and upper corner of its box in its own frame.
    """

    instance_id: int
    name: str
    prototype: str
    category: str
    category_uid: int
    motion_type: Literal["static", "dynamic"]
    instance_type: Literal["object", "human"]
    bounds: NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """Labels and depth of one rendering.

    Attributes:
        segmentation: (H, W) uint64 instance ids, 0 outside the lens circle.
        depth_mm: (H, W) uint16, depth along the optical axis in millimeters, 0 outside the lens circle.
        visibility: for each visible instance id, the fraction of its pixels that nothing occludes, 0..1.
    """

    segmentation: NDArray[np.uint64]
    depth_mm: NDArray[np.uint16]
    visibility: dict[int, float]


@dataclass(frozen=True)
class Frame:
    """One capture of the RGB camera and its ground truth.

    Attributes:
        capture_ns: capture timestamp in device time. The scene is rendered at the middle of the exposure,
            ``ROLLING_SHUTTER_MIDDLE_NS`` later; readers must find that time.
        exposure_s, gain: of this image.
        rgb: (H, W, 3) uint8, with people.
        with_people, without_people: labels and depth (ADT's files with and without skeletons).
        world_from_object: (4, 4) float64 pose of every dynamic object at this moment, by instance id.
        skeletons: by human instance id, (J, 3) float64 joint positions in the world [m].
    """

    capture_ns: int
    exposure_s: float
    gain: float
    rgb: NDArray[np.uint8]
    with_people: View
    without_people: View
    world_from_object: dict[int, NDArray[np.float64]]
    skeletons: dict[int, NDArray[np.float64]]


@dataclass(frozen=True)
class Rest:
    """A time in which an object that people carry lies still.

    Attributes:
        instance_id: of the object; support_id: of the object on which it lies.
        from_ns, until_ns: device time.
    """

    instance_id: int
    support_id: int
    from_ns: int
    until_ns: int


@dataclass(frozen=True)
class Sequence:
    """A whole recording; ``frames`` is lazy, so memory does not grow with the length.

    Attributes:
        size: side of the square RGB image in pixels.
        instances: everything visible, including the room itself (category ``shelter``).
        world_from_static: (4, 4) float64 pose of every static object, by instance id.
        device_pose: (N,) int64 nanoseconds -> (N, 4, 4) float64 ``world_from_device``.
        start_ns, end_ns: first and last moment of the trajectory, device time.
        points: (P, 3) float64 semi-dense points in the world [m].
        inv_dist_std: (P,) float64 [1/m]; dist_std: (P,) float64 [m]: their uncertainty.
        frames: yields the frames in order of time.
        wearer: instance id of the person who wears the device, or None.
        estimated_pose: as ``device_pose``, of the closed-loop trajectory; None if that is exact.
        rests: of the objects that people carry, by object and time; ``truth/rests.tsv`` holds them, if there are any.
    """

    name: str
    size: int
    fps: float
    instances: list[Instance]
    world_from_static: dict[int, NDArray[np.float64]]
    device_pose: Trajectory
    start_ns: int
    end_ns: int
    points: NDArray[np.float64]
    inv_dist_std: NDArray[np.float64]
    dist_std: NDArray[np.float64]
    frames: Callable[[], Iterator[Frame]]
    frame_count: int
    wearer: int | None = None
    estimated_pose: Trajectory | None = None
    rests: tuple[Rest, ...] = ()


# From a capture timestamp to the middle of the exposure: half the rolling shutter
# (docs/method.md#exposure-time).
ROLLING_SHUTTER_MIDDLE_NS = 2_500_000
