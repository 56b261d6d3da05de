"""Import HOI4D recordings (docs/method.md#hoi4d-files), and for evaluation only their motion segmentation. A sequence is a folder
``ZY…/H…/C…/N…/S…/s…/T…`` of the dataset. Masks of hands and handled objects are RGB images, 15 per second, in PASCAL VOC's colors."""

from pathlib import Path

import numpy as np

from egosplat.arrays import Bytes, Ints32
from egosplat.calibration.files import (
    HOI4D_VIDEO,
    find_masks,
    find_sequence,
    intrinsics_files,
    sequence_parts,
)
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.frames.images import read_rgb
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import MAX_AGE_NS, AnnotationKeys, Annotations, Instance, Recording
from egosplat.frames.selection import select_frames
from egosplat.frames.video import open_video
from egosplat.geometry import Camera
from egosplat.images import resize_image, resize_labels

MASKS_PER_SECOND = 15

# intrin.npy has pixel centers at integers, as OpenCV and Open3D do.
_OPENCV_PIXEL_OFFSET = 0.5

# The object of each category, and the meanings of labels 1, 2, … in it (the dataset's
# ``definitions/motion segmentation/label.csv``).
_LABELS: dict[str, tuple[str, ...]] = {
    "C1": ("toy car", "toy car", "right hand"),
    "C2": ("mug", "mug", "right hand", "mug"),
    "C3": ("laptop", "screen", "right hand", "keyboard"),
    "C4": ("storage furniture", "door", "right hand", "body of the cabinet", "drawer", "bottle"),
    "C5": ("bottle", "bottle", "right hand", "mug"),
    "C6": ("safe", "body of the safe", "right hand", "door", "bottle"),
    "C7": ("bowl", "bowl", "right hand", "ball"),
    "C8": ("bucket", "body of the bucket", "right hand", "handle", "body of the bucket", "handle", "left hand"),
    "C9": ("scissors", "left part of the scissors", "right hand", "right part of the scissors"),
    "C11": ("pliers", "left part of the pliers", "right hand", "right part of the pliers"),
    "C12": ("kettle", "kettle", "right hand", "mug"),
    "C13": ("knife", "knife", "right hand", "apple"),
    "C14": ("trash can", "body of the trash can", "right hand", "lid", "bottle"),
    "C17": ("lamp", "base", "right hand", "tube", "top link", "bottom link", "left hand"),
    "C18": ("stapler", "base", "right hand", "slot", "lid", "paper"),
    "C20": ("chair", "chair", "right hand", "left hand"),
}  # fmt: skip
_MAX_LABEL = 6
# RGB of labels 0 to 6: their bits are the highest of red, green and blue.
COLORS = 128 * (np.arange(_MAX_LABEL + 1)[:, None] >> np.arange(3) & 1)
# The dataset's own tools ignore colors of no label; more than this share means another kind of image.
_MAX_UNKNOWN_SHARE = 0.01


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the video and select frames; ``path`` is the folder, or the name with underscores in the root folder. UserError if the
    sequence, its video or its intrinsics are missing, damaged or too small, or no frame is selected."""
    folder = find_sequence(path)
    video = open_video(folder / HOI4D_VIDEO)
    (width, height), resolution = video.size, options.resolution
    if resolution > width:
        raise UserError(
            f"frames.resolution: {resolution} px, but {video.path} has {width}. Choose 32 to {width}."
        )
    if not (files := intrinsics_files(folder)):
        place = f"camera_params/{sequence_parts(folder)[0]}/intrin.npy"
        raise UserError(f"{folder}: has no intrinsics. Put them at {place} in the dataset's root folder.")
    camera = read_intrinsics(files[0], width, height)
    camera = camera.scaled_to(resolution, max(1, round(height * resolution / width)))
    video = video.keep(select_frames(video.timestamp_ns, options, video.path))
    return Recording(
        timestamp_ns=video.timestamp_ns,
        exposure_middle_ns=video.timestamp_ns,
        camera=camera,
        camera_known=True,
        valid=np.ones((camera.height, camera.width), dtype=bool),
        read_frames=lambda indices: (
            resize_image(image, camera.width, camera.height) for image in video.read_frames(indices)
        ),
    )


def read_intrinsics(path: Path, width: int, height: int) -> Camera:
    """Read the 3x3 intrinsic matrix of ``width`` x ``height`` px; UserError if it is unreadable or no such matrix."""
    try:
        with path.open("rb") as file:
            matrix = np.asarray(np.lib.format.read_array(file, allow_pickle=False), dtype=np.float64)
    except Exception as error:  # NumPy reads the header as Python
        raise UserError(f"{path}: not a readable NumPy array ({error}). Download it again.") from error
    upper = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 0]], dtype=bool)
    if matrix.shape == (3, 3) and np.allclose(matrix[~upper], [0, 0, 0, 0, 1], atol=1e-6):
        matrix[:2, 2] += _OPENCV_PIXEL_OFFSET
        lens = Lens("PINHOLE", width, height, (*matrix.diagonal()[:2].tolist(), *matrix[:2, 2].tolist()))
        return lens.check(str(path)).pinhole
    form = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    raise UserError(f"{path}: no intrinsics {form} of the {width}x{height} px video.")


def open_annotations(path: Path, keys: AnnotationKeys) -> Annotations | None:
    """Open the masks of a sequence; None if it has none, UserError if its object category is unknown. Maps are read with
    UserError if the mask is unreadable, or of another shape or other colors. Ids are labels 1 to 6."""
    folder, camera = find_sequence(path), keys.camera
    if (masks := find_masks(folder)) is None:
        return None

    def read(timestamp_ns: int) -> Ints32 | None:
        number = round(timestamp_ns * MASKS_PER_SECOND / 1e9)
        mask = masks / f"{number:05d}.png"
        age_ns = abs(timestamp_ns - round(number * 1e9 / MASKS_PER_SECOND))
        if age_ns > MAX_AGE_NS or not mask.is_file():
            return None
        labels = decode_labels(read_rgb(mask))
        if (unknown := float((labels < 0).mean())) > _MAX_UNKNOWN_SHARE:
            raise UserError(f"{mask}: {unknown:.0%} of the colors are of no label. Download it again.")
        height, width = labels.shape
        if abs(height * camera.width - width * camera.height) > max(width, camera.width):
            raise UserError(f"{mask}: {width}x{height} px: another aspect ratio than the video's.")
        fitted = resize_labels(np.maximum(labels - 1, -1), camera.width, camera.height)
        return np.asarray(fitted, np.int32)[None]

    return Annotations(instances_of(sequence_parts(folder)[2], folder), read)


def instances_of(category: str, folder: Path) -> list[Instance]:
    """The instances of labels 1 to 6 of a category ``C1`` … ``C20``; UserError if HOI4D has no such category."""
    if category not in _LABELS:
        raise UserError(f"{folder}: {category} is not an object category of HOI4D.")
    # A label without a documented meaning gets the name of the object. HOI4D labels only what moves or is moved.
    thing, *meanings = _LABELS[category]
    meanings += [thing] * (_MAX_LABEL - len(meanings))
    instances = []
    for label, meaning in enumerate(meanings, start=1):
        name = f"{meaning.title().replace(' ', '')}_{label}"
        kind = "human" if meaning.endswith(" hand") else "object"
        instances.append(Instance(label, name, meaning, "dynamic", kind))
    return instances


def decode_labels(mask: Bytes) -> Ints32:
    """(H, W, 3) uint8 RGB mask -> (H, W) int32 labels 0 (none) to 6; -1 for other colors."""
    labels = np.full(mask.shape[:2], -1, np.int32)
    for label, color in enumerate(COLORS):
        labels[(mask == color).all(axis=-1)] = label
    return labels
