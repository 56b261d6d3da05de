"""Read the instance segmentation of Aria Digital Twin (ADT). For evaluation only."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.projects.adt import AriaDigitalTwinDataPaths, AriaDigitalTwinDataProvider

from egosplat.calibration.files import ADT_INSTANCES, ADT_SEGMENTATIONS, adt_video, find_segmentation
from egosplat.errors import UserError
from egosplat.files import read_users_json
from egosplat.frames.adt import RGB_STREAM, open_video, open_vrs, read_checked, rectification
from egosplat.frames.recording import MAX_AGE_NS, AnnotationKeys, Annotations, Instance, check_instance
from egosplat.frames.rectify import Rectification
from egosplat.progress import log

WITH_PEOPLE, WITHOUT_PEOPLE = ADT_SEGMENTATIONS
_FIELDS = ("instance_id", "instance_name", "category", "motion_type", "instance_type")


def open_annotations(folder: Path, keys: AnnotationKeys) -> Annotations | None:
    """Open a sequence's segmentation, preferably with people; None without any, UserError if a file is missing or damaged. Maps
    are read with UserError if they cannot be decoded, or an id is not in ``instances.json``."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder. Give the folder of an ADT sequence.")
    if (path := find_segmentation(folder)) is None:
        return None
    instances = read_instances(folder / ADT_INSTANCES)
    if path.name == WITHOUT_PEOPLE:
        log(f"{folder}: has no {WITH_PEOPLE}; reading {WITHOUT_PEOPLE}, which does not annotate people")
    video, device = adt_video(folder), open_video(folder).get_device_calibration()
    rectified = rectification(device, keys.camera, keys.upright, video)
    provider = open_segmentation(video, path)
    listed = np.array([instance.id for instance in instances], dtype=np.uint64)

    def read(timestamp_ns: int) -> NDArray[np.int32] | None:
        ids = read_checked(path, "", lambda: _ids_near(provider, timestamp_ns, rectified))
        return None if ids is None else _index_of(ids, listed, path)[None]

    return Annotations(instances, read)


def _ids_near(
    provider: AriaDigitalTwinDataProvider, timestamp_ns: int, rectified: Rectification
) -> NDArray[Any] | None:
    """(H, W) uint64 ids of the segmentation that is not older or newer; None if there is none."""
    nearest = provider.get_segmentation_image_by_timestamp_ns(timestamp_ns, RGB_STREAM)
    # The provider returns the nearest segmentation, however far away in time. The ground truth follows the clock of the
    # other cameras, about 0.1 ms off (docs/method.md#annotation-age).
    near = nearest.is_valid() and abs(nearest.dt_ns()) <= MAX_AGE_NS
    return rectified.labels(nearest.data().to_numpy_array()) if near else None


def _index_of(ids: NDArray[Any], listed: NDArray[np.uint64], path: Path) -> NDArray[np.int32]:
    """(H, W) ids -> (H, W) index into the sorted ``listed`` ones, -1 for 0, which lies outside the lens circle."""
    # Ids have up to 64 bits, so a lookup table would be too large.
    index = np.searchsorted(listed, ids).clip(max=len(listed) - 1)
    if len(unknown := ids[(listed[index] != ids) & (ids != 0)]):
        raise UserError(f"{path}: instance id {unknown[0]} is not in instances.json. Download both again.")
    return np.where(ids == 0, -1, index).astype(np.int32)


def read_instances(path: Path) -> list[Instance]:
    """Read ``instances.json``, sorted by id; UserError if it is unreadable, or an entry lacks a field or has a bad value."""
    entries = read_users_json(path, " Download this file of the recording again.")
    if not isinstance(entries, dict) or not entries:
        raise UserError(f"{path}: has no instances. Download it again.")
    instances: dict[int, Instance] = {}
    for key, entry in entries.items():
        where = f"{path}: instance {key}"
        if not isinstance(entry, dict) or any(field not in entry for field in _FIELDS):
            raise UserError(f"{where} lacks one of {', '.join(_FIELDS)}. Download it again.")
        instance = check_instance(where, entry, _FIELDS, largest=2**64 - 1)
        if instances.setdefault(instance.id, instance) is not instance:
            raise UserError(f"{path}: instance_id {instance.id} occurs twice. Download it again.")
    return [instances[identity] for identity in sorted(instances)]


def open_segmentation(video: Path, path: Path) -> AriaDigitalTwinDataProvider:
    """Open the segmentation at ``path`` of a video; UserError if it cannot be read."""
    paths = AriaDigitalTwinDataPaths()
    paths.aria_vrs_filepath, paths.segmentations_filepath = str(video), str(path)
    provider = open_vrs(path, lambda: AriaDigitalTwinDataProvider(paths))
    if not provider.has_segmentation_images():
        raise UserError(f"{path}: has no segmentation. Download it again.")
    return provider
