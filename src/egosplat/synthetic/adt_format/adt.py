"""Write a synthetic recording as an Aria Digital Twin sequence folder (docs/method.md#adt-files)."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.progress import track
from egosplat.synthetic.adt_format.adt_images import create_images
from egosplat.synthetic.adt_format.adt_trajectory import write_trajectories
from egosplat.synthetic.adt_format.adt_truth import TruthTables
from egosplat.synthetic.adt_format.aria import DEVICE_SERIAL
from egosplat.synthetic.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Instance, Sequence

_TRUTH_AFTER_CAPTURE_NS = 90_000


def write_sequence(sequence: Sequence, folder: Path, *, jpeg_quality: int = 95) -> None:
    """Write a complete sequence folder that projectaria-tools' ADT provider opens.

    The folder appears once it is complete. An interrupted run leaves at most a hidden scratch folder.

    Args:
        sequence: the recording; its frames are rendered one by one and not kept.
        folder: the folder to make; must not exist.
        jpeg_quality: 1 to 95.

    Raises:
        UserError: ``folder`` exists.
        ValueError: the sequence contradicts itself.
    """
    if folder.exists():
        raise UserError(f"{folder}: exists already and is not replaced; give another --output")
    with atomic_directory(folder) as scratch:
        truth = TruthTables(sequence)
        captures: list[int] = []
        with create_images(scratch, sequence, jpeg_quality) as images:
            for number, frame in enumerate(_frames(sequence)):
                truth_ns = ground_truth_ns(frame.capture_ns)
                images.write(frame, number, truth_ns)
                truth.add(frame, truth_ns)
                captures.append(frame.capture_ns)
        truth.write(scratch)
        write_documents(scratch, sequence)
        capture_ns = np.array(captures, dtype=np.int64)
        truth_times = np.array([ground_truth_ns(time) for time in captures], dtype=np.int64)
        write_trajectories(scratch, sequence, truth_times, capture_ns + ROLLING_SHUTTER_MIDDLE_NS)


def ground_truth_ns(capture_ns: int) -> int:
    """Timestamp of an image's ground truth, on the microsecond grid.

    ADT's ground truth follows the SLAM cameras, which capture about 0.09 ms after the RGB camera.
    """
    return (capture_ns + _TRUTH_AFTER_CAPTURE_NS + 500) // 1000 * 1000


def _frames(sequence: Sequence) -> Iterator[Frame]:
    """Yield the frames with a progress bar; check their order and number."""
    last_ns, count = None, 0
    for frame in track(sequence.frames(), f"writing {sequence.name}", total=sequence.frame_count):
        if last_ns is not None and frame.capture_ns <= last_ns:
            raise ValueError(f"frame {count} was captured at {frame.capture_ns} ns, not after {last_ns} ns")
        last_ns = frame.capture_ns
        count += 1
        yield frame
    if count != sequence.frame_count:
        raise ValueError(f"{count} frames, not {sequence.frame_count}")


def write_documents(folder: Path, sequence: Sequence) -> None:
    """Write ``instances.json``, ``3d_bounding_box.csv``, ``skeleton_aria_association.json``, ``metadata.json``."""
    _write_json(
        folder / "instances.json", {str(one.instance_id): _instance(one) for one in sequence.instances}
    )
    rows = [_box(one) for one in sequence.instances if one.instance_type == "object"]
    columns = ["object_uid", "timestamp[ns]"]
    columns += [f"p_local_obj_{axis}{end}[m]" for axis in "xyz" for end in ("min", "max")]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "3d_bounding_box.csv", index=False)
    people = [one for one in sequence.instances if one.instance_type == "human"]
    association = {"SkeletonMetadata": [_skeleton(person, sequence.wearer) for person in people]}
    _write_json(folder / "skeleton_aria_association.json", association)
    _write_json(folder / "metadata.json", _metadata(len(people)))


def _instance(one: Instance) -> dict[str, Any]:
    return {
        "instance_id": one.instance_id,
        "instance_name": one.name,
        "prototype_name": one.prototype,
        "category": one.category,
        "category_uid": one.category_uid,
        "motion_type": one.motion_type,
        "instance_type": one.instance_type,
        "rigidity": "deformable" if one.instance_type == "human" else "rigid",
        "rotational_symmetry": {"is_annotated": False},
        "canonical_pose": {"up_vector": [0, 1, 0], "front_vector": [0, 0, 1]},
    }


def _box(one: Instance) -> tuple[float, ...]:
    """A row of the box file. The box is in the instance's own frame and never changes: time -1."""
    return (one.instance_id, -1, *one.bounds.T.ravel().tolist())


def _skeleton(person: Instance, wearer: int | None) -> dict[str, Any]:
    device = DEVICE_SERIAL if person.instance_id == wearer else "NONE"
    return {"AssociatedDeviceSerial": device, "SkeletonId": person.instance_id, "SkeletonName": person.name}


def _metadata(people: int) -> dict[str, Any]:
    """ADT's keys, and ``origin``, which ADT does not have."""
    return {
        "serial": DEVICE_SERIAL,
        # Empty, so that the same sequence gives the same files.
        "gt_creation_time": "",
        "scene": "SyntheticApartment",
        "is_multi_person": False,
        "num_skeletons": people,
        "timecode_enabled": 0,
        "gt_time_domain": "DEVICE_CAPTURE",
        "concurrent_sequence": "",
        # Name and version of the format; projectaria-tools accepts no other name.
        "dataset_name": "ADT_2023",
        "dataset_version": "2.0",
        "origin": "synthetic",
    }


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=2) + "\n")
