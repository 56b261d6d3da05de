"""Read the instance segmentation of Aria Digital Twin (ADT). For evaluation only."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.sensor_data import TimeDomain
from projectaria_tools.projects.adt import AriaDigitalTwinDataPaths, AriaDigitalTwinDataProvider

from egosplat.calibration.files import ADT_INSTANCES, ADT_SEGMENTATIONS, adt_video, find_segmentation
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.frames.adt import RGB_STREAM, device_calibration, open_checked, open_video, rectification
from egosplat.frames.keys import AnnotationKeys
from egosplat.frames.native_log import captured_log, find_damage, log_messages
from egosplat.frames.recording import Instance
from egosplat.progress import log

WITH_PEOPLE, WITHOUT_PEOPLE = ADT_SEGMENTATIONS
_FIELDS = ("instance_id", "instance_name", "category", "motion_type", "instance_type")
_ALLOWED = {"motion_type": ("static", "dynamic"), "instance_type": ("object", "human")}


def open_annotations(path: Path, keys: AnnotationKeys) -> "AdtAnnotations | None":
    """Open a sequence's annotations; None without a segmentation, UserError if it is missing or they are damaged."""
    if not path.is_dir():
        raise UserError(f"{path}: no such folder. Give the folder of an ADT sequence.")
    segmentation = find_segmentation(path)
    return AdtAnnotations(path, segmentation, keys) if segmentation else None


class AdtAnnotations:
    """The annotations of a sequence folder; an ``Annotations``.

    ``segmentations_with_skeleton.vrs`` includes people. Releases without it have ``segmentations.vrs``, which is read
    instead and logged.
    """

    def __init__(self, folder: Path, path: Path, keys: AnnotationKeys) -> None:
        """Open the segmentation at ``path``, and ``instances.json``; UserError if one is missing or damaged."""
        self.instances = read_instances(folder / ADT_INSTANCES)
        self._ids = np.array([instance.id for instance in self.instances], dtype=np.uint64)
        self._path, self._max_age_ns = path, keys.max_age_ns
        if path.name == WITHOUT_PEOPLE:
            log(f"{folder}: has no {WITH_PEOPLE}; reading {WITHOUT_PEOPLE}, which does not annotate people")
        video, opened = adt_video(folder), open_video(folder)
        device = device_calibration(opened, video)
        self._rectification = rectification(device, keys.camera, keys.upright, video)
        self._provider = open_segmentation(video, path)
        self._log_covered(opened.get_timestamps_ns(RGB_STREAM, TimeDomain.DEVICE_TIME))

    def _log_covered(self, frames_ns: list[int]) -> None:
        """Log which part of the recording is annotated, unless all of it is."""
        # The segmentation nearest to a time before all others is the first.
        first, last = (
            time + self._provider.get_segmentation_image_by_timestamp_ns(time, RGB_STREAM).dt_ns()
            for time in (0, 2**62)
        )
        if first > frames_ns[0] + self._max_age_ns or last < frames_ns[-1] - self._max_age_ns:
            start_s, end_s = ((time - frames_ns[0]) * 1e-9 for time in (first, last))
            log(
                f"{self._path}: covers {start_s:.1f} s to {end_s:.1f} s after the first frame, and not the rest"
            )

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """See ``Annotations.instance_map``; UserError if it cannot be decoded, or an id is not in ``instances.json``."""
        try:
            with captured_log() as messages:
                nearest = self._provider.get_segmentation_image_by_timestamp_ns(timestamp_ns, RGB_STREAM)
                # The provider returns the nearest segmentation, however far away in time. The ground truth follows the
                # clock of the other cameras, about 0.1 ms off (docs/method.md#annotation-age).
                if not nearest.is_valid() or abs(nearest.dt_ns()) > self._max_age_ns:
                    return None
                ids = nearest.data().to_numpy_array()
        except RuntimeError as error:
            raise UserError(f"{self._path}: cannot be decoded ({error}). Download it again.") from error
        # The library returns a damaged segmentation partly decoded and only logs lines about it.
        if reason := find_damage(messages):
            raise UserError(f"{self._path}: cannot be decoded ({reason}). Download it again.")
        log_messages(messages, self._path)
        try:
            return self._to_index(self._rectification.labels(ids))
        except ValueError as error:
            raise UserError(f"{self._path}: {error}. Is it of the same recording as video.vrs?") from error

    def _to_index(self, ids: NDArray[np.uint64]) -> NDArray[np.int32]:
        """(H, W) uint64 ids -> (H, W) int32 index into ``instances``."""
        # ``instances`` is sorted by id; ids have up to 64 bits, so a lookup table would be too large.
        index = np.searchsorted(self._ids, ids).clip(max=len(self._ids) - 1)
        unknown = ids[(self._ids[index] != ids) & (ids != 0)]
        if len(unknown):
            raise UserError(
                f"{self._path}: instance id {unknown[0]} is not in instances.json. "
                "Are both of the same recording? Download them again."
            )
        # Id 0 lies outside the lens circle.
        return np.where(ids == 0, -1, index).astype(np.int32)


def read_instances(path: Path) -> list[Instance]:
    """Read ``instances.json``, sorted by id; UserError if it is unreadable, or an entry lacks a field or has a bad value."""
    try:
        entries = read_json(path)
    except FileNotFoundError as error:
        raise UserError(f"{path}: not found. Download this file of the recording.") from error
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not readable as JSON ({error}). Download it again.") from error
    if not isinstance(entries, dict) or not entries:
        raise UserError(f"{path}: has no instances. Download it again.")
    instances: dict[int, Instance] = {}
    for key, entry in entries.items():
        instance = _instance(path, key, entry)
        if instances.setdefault(instance.id, instance) is not instance:
            raise UserError(f"{path}: instance_id {instance.id} occurs twice. Download it again.")
    return [instances[identity] for identity in sorted(instances)]


def _instance(path: Path, key: str, entry: object) -> Instance:
    if not isinstance(entry, dict) or any(field not in entry for field in _FIELDS):
        raise UserError(f"{path}: instance {key} lacks one of {', '.join(_FIELDS)}. Download it again.")
    for field, allowed in _ALLOWED.items():
        if entry[field] not in allowed:
            raise UserError(
                f"{path}: instance {key}: {field} is {entry[field]!r}, not {' or '.join(allowed)}."
            )
    if not isinstance(entry["instance_id"], int) or not 0 < entry["instance_id"] < 2**64:
        raise UserError(f"{path}: instance {key}: instance_id is not a positive whole number of 64 bits.")
    identity, name, category, motion_type, instance_type = (entry[field] for field in _FIELDS)
    return Instance(identity, str(name), str(category), motion_type, instance_type)


def open_segmentation(video: Path, path: Path) -> AriaDigitalTwinDataProvider:
    """Open the segmentation at ``path`` of a video; UserError if it cannot be read."""
    paths = AriaDigitalTwinDataPaths()
    paths.aria_vrs_filepath, paths.segmentations_filepath = str(video), str(path)
    provider = open_checked(path, lambda: AriaDigitalTwinDataProvider(paths))
    if not provider.has_segmentation_images():
        raise UserError(f"{path}: has no segmentation. Download it again.")
    return provider
