"""What a file or folder is as a recording: its format, its number of frames, and the keys that suit it."""

import hashlib
import os
import re
import zipfile
import zlib
from collections.abc import Mapping
from lzma import LZMAError
from pathlib import Path
from typing import NamedTuple

import cv2

from egosplat.calibration.files import (
    ADT_VIDEOS,
    AUTO,
    KNOWN_POSES,
    PICTURES,
    TRAJECTORIES,
    adt_video,
    list_pictures,
    other_poses,
    present_known_poses,
)
from egosplat.calibration.known_poses import find_known_poses
from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.frames.native_log import captured_log
from egosplat.frames.pictures import stride_for
from egosplat.frames.video import open_source, open_video
from egosplat.progress import log

_TAKES = "Give a video, a folder or .zip of photographs, a COLMAP or nerfstudio folder, or a .vrs"

# FFmpeg opens other files, too: it reads a text as a film of its letters.
_VIDEOS = (
    *(".mp4", ".m4v", ".mov", ".3gp", ".avi", ".mkv", ".webm", ".ts", ".mts", ".m2ts", ".mpg", ".mpeg"),
    *(".wmv", ".flv", ".h264", ".h265"),
)

# How many times its size an archive of pictures cannot hold: a bomb does. Texts hold ten times theirs.
_MOST_PACKED = 100

# Of a damaged archive, an encrypted one, one with another compression or coding of names, and one with a file in a file.
_FAULTS = (zipfile.BadZipFile, zlib.error, LZMAError, EOFError, RuntimeError, ValueError, NotADirectoryError)


class Source(NamedTuple):
    """A recording: format and path as the table of scenes names them, what it is in a few words, and keys that suit it."""

    format: str
    path: Path
    about: str
    options: Mapping[str, str]


def name_of(given: Path) -> str:
    """Make the name of a scene from that of its file or folder; of a recording of Aria glasses, its folder."""
    path = Path(os.path.abspath(given))
    # Files of Aria's recordings have the same name.
    path = path.parent if path.name in ADT_VIDEOS else path
    stem = path.name if path.is_dir() else path.stem
    return re.sub("[^A-Za-z0-9_-]+", "_", stem).strip("_")[:60] or "scene"


def read_source(given: Path, unpacked: Path, known_poses: str = AUTO) -> Source:
    """Find what a file or folder is, by ``frames.known_poses`` (UserError: it is missing, or no recording). A .zip is unpacked
    beside ``unpacked``, under this name and a digest."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]*:/", str(given)):
        raise UserError(f"{given}: is a URL; download it and give the file")
    if not given.exists():
        raise UserError(f"{given}: does not exist. {_TAKES}")
    # Not resolved: a link has the name that suits Snakemake.
    path, suffix = Path(os.path.abspath(given)), given.suffix.lower()
    if re.search("[\ud800-\udfff]", str(path)):
        # OpenCV would end the process, and no table could name it.
        raise UserError(f"{path}: has letters that are not UTF-8; rename it, or give a link to it")
    if path.is_dir() or suffix == ".zip":
        return _read_folder(find_recording(path if path.is_dir() else unpack(path, unpacked)), known_poses)
    if suffix == ".vrs":
        return _read_glasses(path)
    if suffix in PICTURES or path.name in KNOWN_POSES.values():
        raise UserError(f"{given}: is one file of a recording; give its folder, {path.parent}")
    if suffix not in _VIDEOS:
        raise UserError(f"{given}: is no video by its name, such as .mp4. {_TAKES}")
    return _read_video(path, known_poses)


def find_recording(folder: Path) -> Path:
    """Find the folder of a recording in a folder: itself, or below it while there is a single folder to go on with."""
    while not (_has_recording(folder) or _videos(folder)) and len(inner := _folders(folder)) == 1:
        (folder,) = inner
    return folder


def _folders(folder: Path) -> list[Path]:
    """Folders that may hold a recording; hidden ones, and what macOS packs into archives, hold none."""
    inner = (path for path in folder.iterdir() if path.is_dir() and path.name != "__MACOSX")
    return sorted(path for path in inner if path.name[0] != ".")


def _has_recording(folder: Path) -> bool:
    return bool(present_known_poses(folder, AUTO) or adt_video(folder).exists() or list_pictures(folder))


def _videos(folder: Path) -> list[Path]:
    # macOS leaves ._clip.mp4 beside clip.mp4.
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in _VIDEOS and path.name[0] != ".")


def _read_folder(folder: Path, known_poses: str) -> Source:
    if (video := adt_video(folder)).exists():
        return _read_glasses(video)
    videos = _videos(folder)
    if not _has_recording(folder):
        others = videos or [inner for inner in _folders(folder) if _has_recording(inner)]
        if others:
            names = ", ".join(path.name for path in others[:3])
            told = f"{folder}: holds no pictures, but {names}; give one of them, such as {others[0]}"
            raise UserError(". ".join(filter(None, (told, other_poses(folder)))))
    elif videos:
        log(f"{folder}: takes its pictures, and not {videos[0].name} beside them")
    kind = find_known_poses(folder, known_poses)
    count = len(open_source(folder, kind).pictures)
    poses = "" if kind is None else f" with poses ({KNOWN_POSES[kind]})"
    return Source("plain", folder, f"{count} pictures{poses}", {})


def _read_glasses(video: Path) -> Source:
    if video.name not in ADT_VIDEOS:
        told = f"a recording of Aria glasses is a folder with {' or '.join(ADT_VIDEOS)}; rename the file"
        raise UserError(f"{video}: {told}")
    for trajectory, path in TRAJECTORIES.items():
        if (video.parent / path).is_file():
            about = f"a recording of Aria glasses with poses ({path})"
            return Source("adt", video.parent, about, {"poses.trajectory": trajectory})
    raise UserError(
        f"{video.parent / TRAJECTORIES['closed_loop']}: does not exist, and poses come from there. Fetch the output of "
        "Aria's machine perception services for this recording, and put its folder mps beside the .vrs"
    )


def _read_video(path: Path, known_poses: str) -> Source:
    with captured_log():
        capture = cv2.VideoCapture(str(path))
        is_video = capture.isOpened() and capture.grab()
    if not is_video:
        open_video(path)  # says why
    count, rate = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), capture.get(cv2.CAP_PROP_FPS)
    if count <= 0:  # a stream, or cut off while it was recorded: only reading it tells
        times = open_video(path).timestamp_ns
        count, rate = len(times), 1e9 * len(times) / max(1, int(times[-1]))
    known = find_known_poses(path, known_poses) is not None
    about = f"a video of {count} frames" + (" with poses" if known else "")
    return Source("plain", path, about, {} if known else {"frames.stride": str(stride_for(count, rate))})


def unpack(archive: Path, beside: Path) -> Path:
    """Unpack a .zip, unless this has been done, into the folder of this name and a digest (UserError: it cannot be)."""
    try:
        with zipfile.ZipFile(archive) as opened:
            members = sorted((entry.filename, entry.file_size, entry.CRC) for entry in opened.infolist())
            digest = hashlib.sha256(repr(members).encode()).hexdigest()[:8]
            folder = beside.with_name(f"{beside.name}-{digest}")
            if sum(size for _, size, _ in members) > _MOST_PACKED * archive.stat().st_size:
                told = f"unpacks to more than {_MOST_PACKED} times its size, as no pictures do"
                raise UserError(f"{archive}: {told}; pack it anew")
            if not folder.is_dir():
                with atomic_directory(folder) as scratch:
                    for entry in opened.infolist():
                        _extract(opened, entry, scratch)
    except _FAULTS as error:
        raise UserError(f"{archive}: cannot be unpacked ({error}); copy it again, or pack it anew") from error
    return folder


def _extract(opened: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> None:
    """Unpack one file into a folder (UserError: the folder has one of its name)."""
    # Windows' PowerShell writes names with backslashes. Names outside of the folder, as ../a.png, lead into it.
    entry.filename = entry.filename.replace("\\", "/")
    path = folder.joinpath(*(part for part in entry.filename.split("/") if part not in ("", ".", "..")))
    if not entry.is_dir() and path.exists():
        raise UserError(f"{opened.filename}: holds {path.relative_to(folder)} twice; pack it anew")
    opened.extract(entry, folder)
