"""What happens in a recording of ADT's format, from its ground truth."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.transient.truth import moved_objects
from egosplat.calibration.files import adt_video, find_segmentation
from egosplat.frames.adt import RGB_STREAM
from egosplat.frames.adt_annotations import open_segmentation, read_instances

BOXES = "2d_bounding_box_with_skeleton.csv"
RESTS = "truth/rests.tsv"
# Visibility from which a thing counts as half hidden, and as partly hidden.
HALF, PARTLY = 0.5, 0.9
# A rest between two carries that is neither too short to look nor as long as the recording [s].
RESTS_S = (3.0, 10.0)
COUNTS = ("things", "seen", "moved", "carried", "places")


@dataclass(frozen=True)
class Statistics:
    """Figures of one recording. Shares are fractions; NaN stands for what the recording does not say.

    Attributes:
        seconds: length; things: objects with a name, without the room; seen: those in a picture at some time.
        moved: objects that change their place; carried: objects of ``rests.tsv``.
        places: least number of places at which a carried object lies between two carries for 3 to 10 s.
        rest_s: median time between two carries.
        wearer, others, movers: share of the pixels with the wearer's arms, with other people, and with people and moved
            objects together.
        half_hidden: share of the things seen that are at least half hidden in some frame.
        partly_hidden: share of all sightings in which more than a tenth of a thing is hidden.
    """

    seconds: float
    things: float
    seen: float
    moved: float
    carried: float
    places: float
    rest_s: float
    wearer: float
    others: float
    movers: float
    half_hidden: float
    partly_hidden: float


def statistics_of(recording: Path) -> Statistics:
    """Measure a recording."""
    instances = read_instances(recording / "instances.json")
    things = {one.id for one in instances if one.instance_type == "object" and one.category != "shelter"}
    people = {one.id for one in instances if one.instance_type == "human"}
    moved = moved_objects(recording / "scene_objects.csv")
    boxes = pd.read_csv(recording / BOXES)
    boxes = boxes[boxes.stream_id == str(RGB_STREAM)]
    times = np.sort(boxes["timestamp[ns]"].unique())
    visible = boxes[boxes.object_uid.isin(things)]
    visibility = visible["visibility_ratio[%]"]
    least = visibility.groupby(visible.object_uid).min()
    wearer = _wearer(recording)
    areas = _pixels(recording, times)
    total = sum(areas.values())
    carried, places, rest_s = _rests(recording / RESTS)
    step = np.diff(times).mean() if len(times) > 1 else 0
    return Statistics(
        seconds=float((times[-1] - times[0] + step) * 1e-9),
        things=len(things),
        seen=len(least),
        moved=len(moved),
        carried=carried,
        places=places,
        rest_s=rest_s,
        wearer=sum(areas.get(uid, 0) for uid in wearer) / total,
        others=sum(areas.get(uid, 0) for uid in people - wearer) / total,
        movers=sum(areas.get(uid, 0) for uid in people | moved) / total,
        half_hidden=float((least <= HALF).mean()),
        partly_hidden=float((visibility < PARTLY).mean()),
    )


def _wearer(recording: Path) -> set[int]:
    """Id of the person who wears the device, if the recording has one."""
    path = recording / "skeleton_aria_association.json"
    people = json.loads(path.read_text())["SkeletonMetadata"] if path.exists() else []
    return {one["SkeletonId"] for one in people if one["AssociatedDeviceSerial"] != "NONE"}


def _pixels(recording: Path, times: NDArray[np.int64]) -> dict[int, int]:
    """Pixels of each instance over all frames, without those outside the lens circle."""
    areas: dict[int, int] = {}
    for picture in _segmentations(recording, times):
        ids, counts = np.unique(picture[picture > 0], return_counts=True)
        for uid, count in zip(ids.tolist(), counts.tolist(), strict=True):
            areas[uid] = areas.get(uid, 0) + count
    return areas


def _segmentations(recording: Path, times: NDArray[np.int64]) -> Iterator[NDArray[np.uint64]]:
    path = find_segmentation(recording)
    if path is None:
        raise ValueError(f"{recording}: has no segmentation")
    provider = open_segmentation(adt_video(recording), path)
    for time in times.tolist():
        yield provider.get_segmentation_image_by_timestamp_ns(time, RGB_STREAM).data().to_numpy_array()


def _rests(path: Path) -> tuple[float, float, float]:
    """Carried objects, the least number of places at which one rests for seconds, and the median of such rests."""
    if not path.exists():
        return float("nan"), float("nan"), float("nan")
    rows = pd.read_csv(path, sep="\t")
    rows["seconds"] = (rows["until[ns]"] - rows["from[ns]"]) * 1e-9
    between = rows.groupby("object_uid", group_keys=False)[["object_uid", "place_uid", "seconds"]].apply(
        lambda one: one.iloc[1:-1]
    )
    good = between[between.seconds.between(*RESTS_S)]
    places = good.groupby("object_uid").size().reindex(rows.object_uid.unique(), fill_value=0)
    return len(places), int(places.min()), float(between.seconds.median())


def texts(one: Statistics) -> list[str]:
    """The figures as they are printed."""
    return [_text(field.name, getattr(one, field.name)) for field in fields(one)]


def _text(name: str, value: float) -> str:
    if np.isnan(value):
        return "-"
    if name in ("seconds", "rest_s"):
        return f"{value:.1f}"
    return f"{value:.0f}" if name in COUNTS else f"{100 * value:.1f} %"
