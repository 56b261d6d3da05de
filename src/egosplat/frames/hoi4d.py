"""Import HOI4D recordings (docs/method.md#hoi4d-files).

A sequence is a folder ``ZY…/H…/C…/N…/S…/s…/T…`` of the dataset with the video ``align_rgb/image.mp4``. The
intrinsics are a separate download: ``camera_params/<ZY…>/intrin.npy`` in the dataset's root folder.
"""

from pathlib import Path

import numpy as np

from egosplat.calibration.files import HOI4D_VIDEO, find_sequence, intrinsics_files, sequence_parts
from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat.frames.selection import select_frames
from egosplat.frames.video import Video
from egosplat.geometry import Camera
from egosplat.images import resize_image

# intrin.npy has pixel centers at integers, as OpenCV and Open3D do.
_OPENCV_PIXEL_OFFSET = 0.5


def open_recording(path: Path, options: FramesOptions) -> Recording:
    """Open the video and select frames; ``path`` is the folder, or the name with underscores in the root folder.

    Raises:
        UserError: the sequence, its video or its intrinsics are missing, damaged or too small, or no frame is selected.
    """
    folder = find_sequence(path)
    video = Video(folder / HOI4D_VIDEO)
    width, height, resolution = video.width, video.height, options.resolution
    if resolution > width:
        raise UserError(
            f"resolution: {resolution} px, but {video.path} is {width} px wide. Choose from 1 to {width}."
        )
    camera = read_intrinsics(find_intrinsics(folder), width, height)
    camera = camera.scaled_to(resolution, max(1, round(height * resolution / width)))
    frames = select_frames(video.timestamp_ns, options, video.path)
    times, size = video.timestamp_ns[frames], (camera.width, camera.height)
    return Recording(
        timestamp_ns=times,
        exposure_middle_ns=times,
        camera=camera,
        camera_known=True,
        valid=np.ones(size[::-1], dtype=bool),
        read_frames=lambda indices: (
            resize_image(image, *size) for image in video.read_frames(frames[indices])
        ),
    )


def find_intrinsics(folder: Path) -> Path:
    """Path of ``intrin.npy``, see ``intrinsics_files``; UserError if it does not exist."""
    if files := intrinsics_files(folder):
        return files[0]
    raise UserError(
        f"{folder}: has no intrinsics. Put HOI4D's camera parameters at "
        f"camera_params/{sequence_parts(folder)[0]}/intrin.npy in the dataset's root folder."
    )


def read_intrinsics(path: Path, width: int, height: int) -> Camera:
    """Read the 3x3 intrinsic matrix of ``width`` x ``height`` px; UserError if it is unreadable or no such matrix."""
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
