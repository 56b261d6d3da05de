"""Read the frames of HOI4D recordings (docs/method.md#hoi4d-files).

A sequence is a folder ``ZY…/H…/C…/N…/S…/s…/T…`` of the dataset with the video ``align_rgb/image.mp4``. The
intrinsics are a separate download: ``camera_params/<ZY…>/intrin.npy`` in the dataset's root folder.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.recording import Capture
from egosplat.frames.selection import select_frames
from egosplat.frames.video import Video
from egosplat.geometry import Camera
from egosplat.images import resize_image

# Root folders of the dataset's two downloads: videos and annotations.
RELEASE, ANNOTATIONS = "HOI4D_release", "HOI4D_annotations"

_PARTS = (r"ZY\d+", r"H\d+", r"C\d+", r"N\d+", r"S\d+", r"s\d+", r"T\d+")
_SEQUENCE = re.compile(r"(?:^|/)" + "[/_]".join(f"({part})" for part in _PARTS) + "$")

# intrin.npy has pixel centers at integers, as OpenCV and Open3D do.
_OPENCV_PIXEL_OFFSET = 0.5


class Hoi4dRecording:
    """The frames of one sequence; a ``Recording`` without a device frame."""

    def __init__(
        self, path: Path, *, resolution: int, stride: int, start_s: float, end_s: float | None
    ) -> None:
        """Open the video and select frames.

        Args:
            path: the sequence's folder, or its name with underscores in the dataset's root folder.
            resolution: width of the frames [px], at most the video's; the height keeps the aspect ratio.
            stride, start_s, end_s: see ``selection.select_frames``.

        Raises:
            UserError: the sequence, its video or its intrinsics are missing or damaged, or an option is
                out of range.
        """
        folder = find_sequence(path)
        self._video = Video(folder / "align_rgb" / "image.mp4")
        width, height = self._video.width, self._video.height
        if not 1 <= resolution <= width:
            raise UserError(
                f"resolution: {resolution} px, but {self._video.path} is {width} px wide. Choose from 1 to {width}."
            )
        camera = read_intrinsics(find_intrinsics(folder), width, height)
        times = self._video.timestamp_ns
        self._frames = select_frames(
            times, stride=stride, start_s=start_s, end_s=end_s, source=self._video.path
        )
        target = camera.scaled_to(resolution, max(1, round(height * resolution / width)))
        valid = np.ones((target.height, target.width), dtype=bool)
        self.capture = Capture.of_video(times[self._frames], target, True, valid)

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB frame of each index; see ``Recording.read_frames``.

        Raises:
            UserError: the video ends too early.
        """
        camera = self.capture.camera
        for image in self._video.read_frames(self._frames[indices]):
            yield resize_image(image, camera.width, camera.height)


def find_sequence(path: Path) -> Path:
    """The folder of a sequence that is given as this folder or as ``root/ZY…_H…_C…_N…_S…_s…_T…``.

    Raises:
        UserError: the folder does not exist.
    """
    if path.is_dir():
        return path.absolute()
    parts = sequence_parts(path)
    for root in (path.parent, path.parent / RELEASE):
        if root.joinpath(*parts).is_dir():
            return root.joinpath(*parts).absolute()
    raise UserError(f"{path}: no such sequence. Looked for {path.parent.joinpath(*parts)}.")


def sequence_parts(path: Path) -> tuple[str, ...]:
    """The seven parts of a sequence's name: camera, person, category, object, room, layout, task.

    Raises:
        UserError: the path does not end in a sequence's name.
    """
    match = _SEQUENCE.search(path.as_posix())
    if match is None:
        raise UserError(
            f"{path}: not the name of a HOI4D sequence, such as ZY20210800001/H1/C11/N58/S376/s02/T2."
        )
    return match.groups()


def find_intrinsics(folder: Path) -> Path:
    """Path of ``intrin.npy``: in the sequence or its parent folder, or in ``camera_params/<ZY…>`` of a folder above.

    Raises:
        UserError: the file does not exist.
    """
    camera = sequence_parts(folder)[0]
    nearby = [folder / "intrin.npy", folder.parent / "intrin.npy"]
    above = [parent / "camera_params" / camera / "intrin.npy" for parent in folder.parents]
    for path in [*nearby, *above]:
        if path.is_file():
            return path
    raise UserError(
        f"{folder}: has no intrinsics. Put HOI4D's camera parameters at camera_params/{camera}/intrin.npy "
        "in the dataset's root folder."
    )


def read_intrinsics(path: Path, width: int, height: int) -> Camera:
    """Read the 3x3 intrinsic matrix of images of ``width`` x ``height`` pixels.

    Raises:
        UserError: the file is unreadable or not an intrinsic matrix.
    """
    try:
        with path.open("rb") as file:
            matrix = np.asarray(np.lib.format.read_array(file, allow_pickle=False), dtype=np.float64)
    except (OSError, ValueError, TypeError, EOFError, MemoryError) as error:
        raise UserError(f"{path}: not a readable NumPy array ({error}). Download it again.") from error
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise UserError(f"{path}: not a finite 3x3 matrix (shape {matrix.shape}). Download it again.")
    upper = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 0]], dtype=bool)
    if min(matrix[0, 0], matrix[1, 1]) <= 0 or not np.allclose(matrix[~upper], [0, 0, 0, 0, 1], atol=1e-6):
        raise UserError(f"{path}: not an intrinsic matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    matrix[:2, 2] += _OPENCV_PIXEL_OFFSET
    camera = Camera.from_matrix(matrix, width, height)
    if not camera.contains(matrix[:2, 2]):
        raise UserError(f"{path}: the principal point lies outside the {width}x{height} px video.")
    return camera
