"""ADT's files about the whole sequence: instances, 3D boxes, people, metadata."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from egosplat.synthetic.adt_format.aria import DEVICE_SERIAL
from egosplat.synthetic.adt_format.sequence import Instance, Sequence


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
