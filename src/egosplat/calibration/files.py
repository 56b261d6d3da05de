"""The files of a recording that each stage opens, by its format, and the digest of their bytes.

The workflow imports this module, so it stays light. A missing file is no error here; its reader reports it. A broken link counts
as present for the same reason.
"""

import hashlib
import os
import re
import shlex
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from unicodedata import normalize

from egosplat.errors import UserError
from egosplat.files import expand_home, read_json, read_users_json, user_cache, write_json

Origin = Literal["real", "synthetic"]

# Formats of pictures, with companion files. Labels choose the evaluation frames of the last two.
OF_PICTURES = ("plain", "lerf", "3d_ovs")

# The formats of pictures that are read, their calibration, the mask of the pixels that show the scene in all of them, and
# instant-ngp's mask of the picture NAME.jpg, dynamic_mask_NAME.png: pixels that are not black move, and are left out.
PICTURES = (".png", ".jpg", ".jpeg")
# Formats that are not read: they may hold several images or more than 8 bits, or need further libraries.
OTHER_PICTURES = (
    *(".webp", ".tif", ".tiff", ".bmp", ".gif", ".heic", ".heif", ".avif", ".jxl", ".jp2", ".jpe", ".jfif"),
    *(".exr", ".hdr", ".ppm", ".pgm", ".pbm", ".pnm", ".pfm", ".tga", ".psd", ".qoi", ".mpo", ".hif"),
    *(".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw"),
)
CAMERA_FILE, VALID_MASK, DYNAMIC_MASK = "camera.json", "valid.png", "dynamic_mask_"

# The annotations of a plain recording, the table in their folder, and the names of the classes of a scene of 3D-OVS.
ANNOTATIONS, INSTANCES_TABLE, OVS_CLASSES = "annotations", "instances.tsv", "classes.txt"

# The files with known poses, by the value of ``frames.known_poses``, and its other values: those that are there, and none.
KNOWN_POSES = {"colmap": "colmap", "transforms": "transforms.json"}
AUTO, NONE = "auto", "none"

# The model in the folder of a COLMAP project, whose pictures lie in ``images``, and its files that are read. rigs and frames of
# newer versions repeat what these three say of a single camera. COLMAP itself prefers .bin where both exist.
PROJECT_MODELS, PROJECT_PICTURES = ("sparse/0", "sparse"), "images"
MODEL_FILES, MODEL_SUFFIXES = ("cameras", "images", "points3D"), (".bin", ".txt")

# Recordings of Aria glasses: ADT's name and that of Aria's tools; segmentations, preferably with people; trajectories by the
# value of ``poses.trajectory``; current and older name of the points.
ADT_VIDEOS, ADT_INSTANCES, METADATA = ("video.vrs", "recording.vrs"), "instances.json", "metadata.json"
ADT_SEGMENTATIONS = ("segmentations_with_skeleton.vrs", "segmentations.vrs")
MPS_FOLDER, POINTS = Path("mps") / "slam", ("semidense_points.csv.gz", "global_points.csv.gz")
TRAJECTORIES = {
    "closed_loop": MPS_FOLDER / "closed_loop_trajectory.csv",
    "ground_truth": Path("aria_trajectory.csv"),
}

# Poses that are not read: a pattern of their names, what a file holds, and how they become readable; {0} is the folder, {1} the
# file and {2} its folder. The first are read in a folder above; the last two are COLMAP's models where none is looked for, and what
# other programs and data sets write.
_COPY, _LINK = "cp {1} {0}/transforms.json, and give {0}", "ln -s {2} {0}/colmap, and give {0}"
_CONVERT = "nerfstudio's ns-process-data {1} --data {0} --output-dir NEW makes a folder to give"
_GIVE = "give a COLMAP model as {0}/colmap, or {0}/transforms.json"
_PROJECTS = [f"{model}/cameras.*" for model in PROJECT_MODELS]
_MODELS = ("cameras.bin", "sparse/[1-9]*/cameras.*", "dense/**/cameras.*", "distorted/**/cameras.*")
_OTHERS = (
    *("poses*.*", "groundtruth.txt", "traj.txt", "pose/*", "*.pose.txt", "cams/*.txt"),
    *("cameras.sfm", "sfm_data.json", "bundle.out", "cameras.xml", "cameras.json", "odometry.csv"),
)
OTHER_POSES = {
    **dict.fromkeys(("transforms.json", "colmap/cameras.*", *_PROJECTS), (b"", "give {0}")),
    "transforms_*.json": (b'"frames"', _COPY),
    METADATA: (b'"poses"', _CONVERT.format("{0}", "record3d")),
    "keyframes/*cameras": (b"", _CONVERT.format("{0}", "polycam")),
    **dict.fromkeys(_MODELS, (b"", _LINK)),
    **dict.fromkeys(_OTHERS, (b"", _GIVE)),
}

# HOI4D: its two downloads, videos and annotations; shift_mask is aligned with the video where mask is not.
HOI4D_VIDEO, HOI4D_INTRINSICS = Path("align_rgb") / "image.mp4", "intrin.npy"
HOI4D_ROOTS, HOI4D_MASKS = ("HOI4D_release", "HOI4D_annotations"), ("shift_mask", "mask")
_SEQUENCE = re.compile(r"(?:^|/)" + "[/_]".join(rf"({letter}\d+)" for letter in ("ZY", *"HCNSsT")) + "$")

# nerfstudio writes this file beside a training's config.yml: from the world of the data to that of the Gaussians.
DATAPARSER = "dataparser_transforms.json"


def recording_origin(format: str, recording: Path) -> Origin:
    """``synthetic`` if ``metadata.json`` says that egosplat rendered it, else ``real``; UserError if it cannot be read."""
    path = recording / METADATA
    if format != "adt" or not os.path.lexists(path):
        return "real"
    metadata = read_users_json(path, " Download it again.")
    return "synthetic" if isinstance(metadata, dict) and metadata.get("origin") == "synthetic" else "real"


def digest_of_recording(stage: str, format: str, recording: Path, config: Mapping[str, Any]) -> str:
    """Digest of the names and bytes of all files that a stage opens, 16 hexadecimal digits; arguments as of
    ``opened_files``. Bytes are read again where size, time or inode of a file changed since the last call."""
    files = sorted({*opened_files(stage, format, recording, config)})
    if not files:
        return "none"
    use = hashlib.sha256(f"{stage} {recording.absolute()}".encode()).hexdigest()[:16]
    cache, known = Path("digests", f"{use}.json"), {}
    # ``Path.home`` raises RuntimeError for a user without one.
    with suppress(OSError, RuntimeError, ValueError):
        known = read_json(user_cache() / cache)
    told = {str(path): _digest_of_file(path, known.get(str(path))) for path in files}
    if told != known:
        with suppress(OSError, RuntimeError, UserError):
            write_json(user_cache() / cache, told)
    return hashlib.sha256(repr([(name, row[-1]) for name, row in told.items()]).encode()).hexdigest()[:16]


def _digest_of_file(path: Path, known: list[Any] | None) -> list[Any]:
    """Size, time of change [ns], inode and digest of a file; a broken link or a folder has no bytes."""
    if not path.is_file():
        return ["none"]
    status = path.stat()
    identity = [status.st_size, status.st_mtime_ns, status.st_ino]
    if known is not None and known[:-1] == identity:
        return known
    with path.open("rb") as file:
        return [*identity, hashlib.file_digest(file, "sha256").hexdigest()[:16]]


def opened_files(stage: str, format: str, recording: Path, config: Mapping[str, Any]) -> list[Path]:
    """The existing files of a recording (folder, video, or name of a HOI4D sequence) that frames, annotations
    or poses opens. Of the configuration ``frames.known_poses``, ``poses.method`` and ``poses.trajectory``
    count."""
    known, files = config["frames"]["known_poses"], []
    if stage == "poses":
        source = chosen_poses(format, recording, config)
        if source == "known":
            files = known_pose_files(recording, known)
        elif source == "device":
            trajectory = TRAJECTORIES[config["poses"]["trajectory"]]
            files = [recording / trajectory, find_points(recording / MPS_FOLDER)]
    elif format == "adt":
        more = [recording / ADT_INSTANCES, find_segmentation(recording)]
        files = [adt_video(recording), *([recording / METADATA] if stage == "frames" else more)]
    elif format == "hoi4d":
        with suppress(UserError):
            folder = find_sequence(recording)
            masks = find_masks(folder)
            of_frames = [folder / HOI4D_VIDEO, *intrinsics_files(folder)[:1]]
            files = of_frames if stage == "frames" else list_masks(masks) if masks else []
    elif format not in OF_PICTURES:  # of another package: all that there is
        files = [recording, *recording.rglob("*")]
    elif stage == "frames" or is_annotated(format, recording):
        files = _picture_files(stage, format, recording, known)
    return [path for path in files if path is not None and os.path.lexists(path)]


def _picture_files(stage: str, format: str, recording: Path, known: str) -> list[Path]:
    """The pictures or the video, the masks of single pictures, the known poses, and companions or annotations."""
    files = [recording] if recording.is_file() else []
    for folder in picture_folders(recording, known) if recording.is_dir() else ():
        files += [*list_pictures(folder), *dynamic_masks(folder)]
    files += known_pose_files(recording, known)
    if format != "plain":
        for label in labels_of(format, recording).values():
            files += list_masks(label) if label.is_dir() else [label]
        files.append(labels_folder(format, recording) / OVS_CLASSES)
    elif stage == "annotations":
        folder = companion_path(recording, ANNOTATIONS)
        files += [folder / INSTANCES_TABLE, *list_masks(folder)]
    if stage == "frames":
        files += [companion_path(recording, name) for name in (CAMERA_FILE, VALID_MASK)]
    return files


def chosen_poses(format: str, recording: Path, config: Mapping[str, Any]) -> str:
    """``poses_source`` of a recording by the configuration, before its frames are read."""
    known = format in OF_PICTURES and present_known_poses(recording, config["frames"]["known_poses"])
    return poses_source(config["poses"]["method"], format == "adt", bool(known))


def poses_source(method: str, has_device: bool, has_known: bool) -> str:
    """Where poses come from, by ``poses.method`` and what there is: ``device``, ``known`` or ``colmap``."""
    if method != AUTO:
        return method
    return "known" if has_known else "device" if has_device else "colmap"


def is_annotated(format: str, path: Path) -> bool:
    """Whether a recording comes with annotations, judged without reading them; HOI4D, LERF-OVS and 3D-OVS do."""
    if format == "adt":
        # Other recordings of Aria glasses have no segmentation; one that does not exist yet is a synthetic one.
        return find_segmentation(path) is not None or not path.is_dir()
    return format != "plain" or os.path.lexists(companion_path(path, ANNOTATIONS))


def companion_path(source: Path, name: str) -> Path:
    """Path of a companion file of a plain recording: in the image folder, or next to the video as ``clip.mp4.<name>``."""
    return source / name if source.is_dir() else source.with_name(f"{source.name}.{name}")


def list_pictures(folder: Path) -> list[Path]:
    """The pictures of a plain recording, in no order; masks are none."""
    files = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.name[0] != "."]
    masks = {folder / VALID_MASK, *dynamic_masks(folder)}
    return [path for path in files if path not in masks and not path.is_dir()]


def dynamic_masks(folder: Path) -> list[Path]:
    """instant-ngp's masks of single pictures in a folder, sorted."""
    return sorted(folder.glob(f"{DYNAMIC_MASK}*.png"))


def list_masks(folder: Path) -> list[Path]:
    """The PNG files of a folder, sorted; none without the folder. macOS leaves ._0.png beside 0.png."""
    return sorted(folder.glob("[!.]*.png"))


def labels_folder(format: str, recording: Path) -> Path:
    """The folder with a benchmark's labels: of 3D-OVS in the scene, of LERF-OVS ``label/SCENE`` beside it."""
    whole = recording.absolute()
    return whole.parent / "label" / whole.name if format == "lerf" else recording / "segmentations"


def labels_of(format: str, recording: Path) -> dict[str, Path]:
    """The label of each labeled picture of a benchmark, by its name, sorted: a file (LERF-OVS), or a folder of masks (3D-OVS)."""
    folder, suffix = labels_folder(format, recording), ".json" if format == "lerf" else ""
    # macOS leaves ._frame_00041.json beside frame_00041.json.
    labels = sorted(path for path in folder.glob(f"*{suffix}") if not path.name.startswith("."))
    return {path.name.removesuffix(suffix): path for path in labels if suffix or path.is_dir()}


def adt_video(folder: Path) -> Path:
    """The recording of a sequence of Aria glasses, whether it exists or not."""
    paths = [folder / name for name in ADT_VIDEOS]
    return next(filter(os.path.lexists, paths), paths[0])


def find_segmentation(folder: Path) -> Path | None:
    """The segmentation of an ADT sequence, preferably the one with people; None if there is none."""
    return next((path for name in ADT_SEGMENTATIONS if os.path.lexists(path := folder / name)), None)


def find_points(folder: Path) -> Path | None:
    """The point cloud in an MPS folder; None if there is none."""
    return next((path for name in POINTS if (path := folder / name).is_file()), None)


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
        example = "ZY20210800001/H1/C11/N58/S376/s02/T2"
        raise UserError(f"{path}: not the name of a HOI4D sequence, such as {example}.")
    return match.groups()


def intrinsics_files(folder: Path) -> list[Path]:
    """The existing intrinsics of a HOI4D sequence: in it, in its parent, or in ``camera_params/<ZY…>`` of a folder above."""
    above = [parent / "camera_params" / sequence_parts(folder)[0] for parent in folder.parents]
    return [path for each in (folder, folder.parent, *above) if (path := each / HOI4D_INTRINSICS).is_file()]


def find_masks(folder: Path) -> Path | None:
    """The mask folder of a HOI4D sequence; None if there is none. Its two downloads may have separate root folders."""
    release, annotations = HOI4D_ROOTS
    elsewhere = Path(folder.as_posix().replace(f"/{release}/", f"/{annotations}/"))
    candidates = [root / "2Dseg" / name for root in (folder, elsewhere) for name in HOI4D_MASKS]
    return next((path for path in candidates if path.is_dir()), None)


def present_known_poses(recording: Path, wanted: str) -> list[str]:
    """The kinds of known poses of a recording that ``frames.known_poses`` allows, keys of ``KNOWN_POSES``."""
    kinds = [] if wanted == NONE else [*KNOWN_POSES] if wanted == AUTO else [wanted]
    present = [kind for kind in kinds if os.path.lexists(known_poses_path(recording, kind))]
    if len(present) > 1 and not model_files(known_poses_path(recording, "colmap")):
        # nerfstudio keeps COLMAP's database in a folder of this name.
        present.remove("colmap")
    return present


def other_poses(recording: Path) -> str | None:
    """Name poses in a folder or above it that are not read, and what makes them readable; None if there are none."""
    for name, (key, advice) in OTHER_POSES.items():
        for folder in (recording, *recording.absolute().parents[:2]):
            for path in sorted(folder.glob(name)):
                # Many programs write a metadata.json, which may be another user's.
                if not key or (path.is_file() and os.access(path, os.R_OK) and key in path.read_bytes()):
                    quoted = (shlex.quote(str(one)) for one in (folder, path, path.parent.absolute()))
                    return f"{path}: these poses are not read; {advice.format(*quoted)}"
    return None


def known_poses_path(recording: Path, kind: str) -> Path:
    """The file or folder with the known poses of a kind, which need not exist."""
    path = companion_path(recording, KNOWN_POSES[kind])
    folders = (path, *(recording / name for name in PROJECT_MODELS)) if kind == "colmap" else ()
    return next(filter(model_files, folders), path)


def check_parts(recording: Path) -> None:
    """UserError if a COLMAP project, which numbers the models of unconnected parts, has one with more pictures than ``sparse/0``."""
    model = known_poses_path(recording.absolute(), "colmap")
    others = sorted(model.parent.glob("[1-9]*")) if model.name == "0" else []
    # One alone is not read: an hour's has gigabytes.
    if others and (largest := max([model, *others], key=lambda part: len(_names(part)))) != model:
        own = recording.absolute() / "colmap"
        aside = shlex.join(["mv", str(own), f"{own}_old"]) + " && " if own.exists() else ""
        link = shlex.join(["ln", "-s", str(largest), str(own)])
        raise UserError(
            f"{model}: {largest} has more pictures, of another part. Choose one, as by: {aside}{link}"
        )


def known_pose_files(recording: Path, wanted: str) -> list[Path]:
    """The files of a recording's known poses, with points and masks; those of every kind if it has several."""
    files: list[Path] = []
    for kind in present_known_poses(recording, wanted):
        path = known_poses_path(recording, kind)
        if kind == "colmap":
            files += model_files(path)
        else:
            points, frames = _read_frames(path)
            given = [points, *(frame.get("mask_path") for frame in frames)]
            named = dict.fromkeys(name for name in given if isinstance(name, str) and name)
            files += [path, *(named_path(path.parent, name) for name in named)]
    return files


def model_files(folder: Path) -> list[Path]:
    """The three files of a COLMAP model, all .bin or all .txt; fewer if one is missing in both formats."""
    every = [[folder / f"{name}{suffix}" for name in MODEL_FILES] for suffix in MODEL_SUFFIXES]
    return max(([file for file in files if file.is_file()] for files in every), key=len)


def picture_folders(recording: Path, wanted: str) -> list[Path]:
    """The folders with the pictures of a folder's recording: those that its known poses name, or the folder
    itself. A folder without pictures may have them in ``images``."""
    kinds = present_known_poses(recording, wanted)
    names = [name for kind in kinds for name in _names(known_poses_path(recording, kind))]
    roots = [root for root in (recording, recording / PROJECT_PICTURES) if root.is_dir()]
    choices = [*(_named_folders(recording, root, names) for root in roots), *([root] for root in roots)]
    for folders in choices:
        if any(map(list_pictures, folders)):
            return folders
    return [recording]


def _named_folders(recording: Path, root: Path, names: list[str]) -> list[Path]:
    """The folders of a recording to which names lead from ``root``; of a name from elsewhere its end does."""
    whole, folders = os.path.normpath(recording), dict[Path, None]()
    for parts in dict.fromkeys(PurePosixPath(name.replace("\\", "/")).parts[:-1] for name in names):
        ends = (named_path(root, "/".join(parts[start:])) for start in range(len(parts) or 1))
        inside = (end for end in map(os.path.normpath, ends) if Path(end).is_relative_to(whole))
        folders |= dict.fromkeys(map(Path, [end for end in inside if os.path.isdir(end)][:1]))
    return [*folders]


def named_path(folder: Path, name: str) -> Path:
    """What a name of a user's file, with / or \\, leads to from a folder, however its letters are composed (macOS takes ü apart)."""
    plain = name.replace("\\", "/")
    spelled = (folder / each for each in (plain, *(normalize(form, plain) for form in ("NFC", "NFD"))))
    return next(filter(os.path.lexists, spelled), folder / plain)


def _names(path: Path) -> list[str]:
    """The names of pictures in a model's folder or a ``transforms.json``; none of a damaged one, whose reader reports it."""
    if not path.is_dir():
        return [name for frame in _read_frames(path)[1] if isinstance(name := frame.get("file_path"), str)]
    names: list[str] = []
    with suppress(OSError, ValueError, IndexError, struct.error):
        (file,) = (file for file in model_files(path) if file.stem == "images")
        if file.suffix == ".txt":
            lines = file.read_text(encoding="utf-8").splitlines()
            # The tenth word of every second line.
            rows = [line for line in lines if not line.startswith("#")][::2]
            return [line.split(maxsplit=9)[9].strip() for line in rows if line.strip()]
        content, position = file.read_bytes(), 8
        for _ in range(*struct.unpack_from("<Q", content)):
            name, position = next_image(content, position)
            names.append(name.decode())
    return names


def next_image(content: bytes, position: int) -> tuple[bytes, int]:
    """Name and end of an image of ``images.bin``: the name is after 64 bytes of numbers, and before 24 for each point."""
    end = content.index(b"\0", position + 64)
    return content[position + 64 : end], end + 9 + 24 * struct.unpack_from("<Q", content, end + 1)[0]


def _read_frames(path: Path) -> tuple[Any, list[dict[str, Any]]]:
    """The file of points and the frames in a ``transforms.json``; nothing of a damaged one, whose reader reports it."""
    with suppress(OSError, ValueError, AttributeError, TypeError, KeyError):
        document = read_json(path)
        frames = [frame for frame in document["frames"] if isinstance(frame, dict)]
        return document.get("ply_file_path"), frames
    return None, []


def source_files(source: str) -> list[Path]:
    """The Gaussians of ``splats.source``, and nerfstudio's transform beside them; UserError if there is no such file."""
    path = expand_home(source)
    if path.is_dir():
        raise UserError(
            f"splats.source: {path} is a folder; give a file in it, such as point_cloud/iteration_30000/point_cloud.ply"
        )
    if not path.is_file():
        raise UserError(f"splats.source: there is no file {path}. Give the path of a .ply or .spz file")
    beside = path.with_name(DATAPARSER)
    return [path, beside] if beside.is_file() else [path]
