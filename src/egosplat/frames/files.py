"""The files of a recording that the stages ``frames`` and ``annotations`` open: the readers find them here, and so do the rules.

The workflow imports this module, so it stays light. A missing file is no error here; its reader reports it.
"""

import hashlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

from egosplat.calibration.companions import (
    PICTURES,
    companion_path,
    known_pose_files,
    mask_files,
    picture_folders,
)
from egosplat.errors import UserError
from egosplat.pipeline.recording_origin import METADATA

# The first is ADT's, the second that of Aria Everyday Activities and of Aria's tools.
ADT_VIDEOS, ADT_INSTANCES = ("video.vrs", "recording.vrs"), "instances.json"

# Folder with the annotations of a plain recording.
ANNOTATIONS = "annotations"

# Of an ADT sequence, in order of preference: releases without people's masks have the second.
ADT_SEGMENTATIONS = ("segmentations_with_skeleton.vrs", "segmentations.vrs")

HOI4D_VIDEO, HOI4D_INTRINSICS = Path("align_rgb") / "image.mp4", "intrin.npy"

# Root folders of HOI4D's two downloads: videos and annotations.
HOI4D_ROOTS = ("HOI4D_release", "HOI4D_annotations")

# In order of preference: shift_mask is aligned with the video where mask is not.
HOI4D_MASKS = ("shift_mask", "mask")

# The calibration of plain pictures, and the mask of their pixels that show the scene, which is not one of the pictures.
CAMERA_FILE, VALID_MASK = "camera.json", "valid.png"

# The table of instances in the folder of a plain recording's annotations.
INSTANCES_TABLE = "instances.tsv"

# The names of the classes of a scene of 3D-OVS, one a line.
OVS_CLASSES = "classes.txt"

# instant-ngp's mask of a picture lies next to it, as PREFIX + its name without suffix + .png: pixels that are not black
# move, and are left out.
DYNAMIC_MASK = "dynamic_mask_"

_PARTS = (r"ZY\d+", r"H\d+", r"C\d+", r"N\d+", r"S\d+", r"s\d+", r"T\d+")
_SEQUENCE = re.compile(r"(?:^|/)" + "[/_]".join(f"({part})" for part in _PARTS) + "$")


def frames_files(format: str, recording: Path, known_poses: str) -> list[Path]:
    """The existing files that the stage ``frames`` opens; of a folder of pictures, without the pictures.

    Args:
        format: of the recording, as in the table of scenes.
        recording: folder, or video file.
        known_poses: ``frames.known_poses``.
    """
    if format == "adt":
        return _existing(adt_video(recording), recording / METADATA)
    if format == "hoi4d":
        folder = _sequence(recording)
        return [] if folder is None else _existing(folder / HOI4D_VIDEO, *intrinsics_files(folder)[:1])
    companions = [companion_path(recording, name) for name in (CAMERA_FILE, VALID_MASK)]
    video = [] if recording.is_dir() else [recording]
    labels = label_files(format, recording)
    return _existing(*video, *companions, *known_pose_files(recording, known_poses), *labels)


def annotations_files(format: str, recording: Path, known_poses: str) -> list[Path]:
    """The existing files that the stage ``annotations`` opens, without masks and pictures; arguments as above."""
    if format == "adt":
        found = find_segmentation(recording)
        return _existing(adt_video(recording), recording / ADT_INSTANCES, *([found] if found else []))
    if format == "hoi4d" or not is_annotated(format, recording):
        return []
    if format != "plain":
        return _existing(*known_pose_files(recording, known_poses), *label_files(format, recording))
    video = [] if recording.is_dir() else [recording]
    table = companion_path(recording, ANNOTATIONS) / INSTANCES_TABLE
    return _existing(*video, table, *known_pose_files(recording, known_poses))


def pictures_of(stage: str, format: str, recording: Path, known_poses: str) -> list[Path]:
    """The images of folders that a stage opens some or all of, of which there may be thousands; arguments as above."""
    if format == "adt" or stage not in ("frames", "annotations"):
        return []
    if format == "hoi4d":
        folder = _sequence(recording)
        masks = folder and find_masks(folder)
        return list_masks(masks) if masks and stage == "annotations" else []
    folders = picture_folders(recording, known_poses) if recording.is_dir() else []
    pictures = [picture for folder in folders for picture in list_pictures(folder)]
    pictures += [mask for folder in folders for mask in dynamic_masks(folder)]
    pictures += mask_files(recording, known_poses)
    if format == "3d_ovs":
        pictures += [mask for folder in labels_of(format, recording).values() for mask in list_masks(folder)]
    elif format == "plain" and stage == "annotations" and is_annotated(format, recording):
        pictures += list_masks(companion_path(recording, ANNOTATIONS))
    return pictures


def is_annotated(format: str, path: Path) -> bool:
    """Whether a recording comes with annotations, judged without reading them.

    HOI4D, LERF-OVS and 3D-OVS do. An ADT recording does if it has a segmentation, which other recordings of Aria glasses have not;
    one that does not exist yet is a synthetic one. A plain recording does if its annotations folder exists.
    """
    if format == "adt":
        return find_segmentation(path) is not None or not path.is_dir()
    # A broken link counts as present: the annotations stage then reports it.
    return format != "plain" or os.path.lexists(companion_path(path, ANNOTATIONS))


def find_segmentation(folder: Path) -> Path | None:
    """The segmentation of an ADT sequence, preferably the one with people; None if there is none."""
    candidates = [folder / name for name in ADT_SEGMENTATIONS]
    # A broken link is not a missing file: opening it reports the error.
    return next((path for path in candidates if os.path.lexists(path)), None)


def label_files(format: str, recording: Path) -> list[Path]:
    """The files with the labels of a benchmark's recording; of 3D-OVS without the masks. None of other formats."""
    if format == "lerf":
        return list(labels_of(format, recording).values())
    return _existing(labels_folder(format, recording) / OVS_CLASSES) if format == "3d_ovs" else []


def labels_folder(format: str, recording: Path) -> Path:
    """The folder with a benchmark's labels: of 3D-OVS in the scene, of LERF-OVS ``label/SCENE`` beside it."""
    whole = recording.absolute()
    return whole.parent / "label" / whole.name if format == "lerf" else recording / "segmentations"


def labels_of(format: str, recording: Path) -> dict[str, Path]:
    """The label of each labeled picture of a benchmark, by its name, sorted: a file (LERF-OVS), or a folder of masks (3D-OVS)."""
    folder, suffix = labels_folder(format, recording), ".json" if format == "lerf" else ""
    # macOS leaves ._frame_00041.json beside frame_00041.json.
    found = sorted(path for path in folder.glob(f"*{suffix}") if not path.name.startswith("."))
    return {path.name.removesuffix(suffix): path for path in found if suffix or path.is_dir()}


def digest_of_files(files: Iterable[Path]) -> str:
    """Hash of names, sizes and times of change; it changes with a file that is overwritten in place."""
    told = []
    for file in sorted(files):
        status = file.stat() if file.exists() else file.lstat()  # a broken link
        told.append((str(file), status.st_size, status.st_mtime_ns))
    return hashlib.sha256(repr(told).encode()).hexdigest()[:16]


def adt_video(folder: Path) -> Path:
    """The recording of a sequence of Aria glasses, whether it exists or not; ADT has another name than Aria's own tools."""
    return next(
        (folder / name for name in ADT_VIDEOS if os.path.lexists(folder / name)), folder / ADT_VIDEOS[0]
    )


def list_pictures(folder: Path) -> list[Path]:
    """The pictures of a plain recording, in no order."""
    files = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.name[0] != "."]
    return [path for path in files if not _is_mask(path.name) and path.is_file()]


def dynamic_masks(folder: Path) -> list[Path]:
    """instant-ngp's masks of single pictures in a folder, sorted."""
    return sorted(folder.glob(f"{DYNAMIC_MASK}*.png"))


def dynamic_mask(picture: Path) -> Path:
    """Path of instant-ngp's mask of a picture, which need not exist."""
    return picture.with_name(f"{DYNAMIC_MASK}{picture.stem}.png")


def _is_mask(name: str) -> bool:
    return name == VALID_MASK or (name.startswith(DYNAMIC_MASK) and name.endswith(".png"))


def list_masks(folder: Path) -> list[Path]:
    """The PNG files of a folder, sorted; none without the folder."""
    return sorted(folder.glob("*.png"))


def find_sequence(path: Path) -> Path:
    """The folder of a HOI4D sequence, given as it is or as ``root/ZY…_H…_C…_N…_S…_s…_T…``; UserError if there is none."""
    if path.is_dir():
        return path.absolute()
    parts = sequence_parts(path)
    for root in (path.parent, path.parent / HOI4D_ROOTS[0]):
        if root.joinpath(*parts).is_dir():
            return root.joinpath(*parts).absolute()
    raise UserError(f"{path}: no such sequence. Looked for {path.parent.joinpath(*parts)}.")


def sequence_parts(path: Path) -> tuple[str, ...]:
    """Camera, person, category, object, room, layout and task of a HOI4D sequence; UserError if its path does not end so."""
    match = _SEQUENCE.search(path.as_posix())
    if match is None:
        raise UserError(
            f"{path}: not the name of a HOI4D sequence, such as ZY20210800001/H1/C11/N58/S376/s02/T2."
        )
    return match.groups()


def intrinsics_files(folder: Path) -> list[Path]:
    """The existing intrinsics of a HOI4D sequence: in it, in its parent, or in ``camera_params/<ZY…>`` of a folder above."""
    camera = sequence_parts(folder)[0]
    nearby = [folder / HOI4D_INTRINSICS, folder.parent / HOI4D_INTRINSICS]
    above = [parent / "camera_params" / camera / HOI4D_INTRINSICS for parent in folder.parents]
    return [path for path in (*nearby, *above) if path.is_file()]


def find_masks(folder: Path) -> Path | None:
    """The mask folder of a HOI4D sequence; None if there is none. Its two downloads may have separate root folders."""
    release, annotations = HOI4D_ROOTS
    elsewhere = Path(folder.as_posix().replace(f"/{release}/", f"/{annotations}/"))
    candidates = [root / "2Dseg" / name for root in (folder, elsewhere) for name in HOI4D_MASKS]
    return next((path for path in candidates if path.is_dir()), None)


def _sequence(recording: Path) -> Path | None:
    try:
        folder = find_sequence(recording)
        sequence_parts(folder)
    except UserError:
        return None
    return folder


def _existing(*paths: Path) -> list[Path]:
    return [path for path in paths if path.is_file()]
