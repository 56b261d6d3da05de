"""COLMAP's first step: images on disk, their shared camera, and SIFT features in the database."""

import contextlib
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.colmap.movement import check_camera_moves
from egosplat.errors import UserError
from egosplat.files import scratch_directory
from egosplat.geometry import Camera
from egosplat.progress import track

Item = TypeVar("Item")

# An image with fewer features has too little texture to be registered.
MIN_FEATURES = 50
MIN_IMAGES = 3

_IMAGES_PER_BATCH = 8
_FATAL_ONLY = 3
# More than a batch writes: 8 images of 8,192 features of 152 bytes, or 100 pairs of 8,192 matches of 16 bytes, twice
# in SQLite.
_MIN_FREE_BYTES = 2**25

# Distance of features from the edge of the valid region, as a fraction of the image height.
_MASK_MARGIN = 0.01


class Project:
    """The files of one COLMAP run in a folder, and the names of its images in the order of the frames."""

    def __init__(self, folder: Path) -> None:
        self.database = folder / "database.db"
        self.images = folder / "images"
        self.mask = folder / "mask.png"
        self.masks = folder / "masks"
        self.pairs = folder / "pairs.txt"
        self.vocabulary = folder / "vocabulary.bin"
        self.models = folder / "models"
        self.names: list[str] = []
        self.images.mkdir()
        self.models.mkdir()

    def check_free_space(self) -> None:
        """Raise UserError unless the disk has room for the next batch."""
        # COLMAP aborts the whole process if SQLite cannot write.
        if (free := shutil.disk_usage(self.images).free) < _MIN_FREE_BYTES:
            raise UserError(
                f"{self.images.parent.parent}: {free >> 20} MiB are free, and COLMAP needs {_MIN_FREE_BYTES >> 20} "
                "for its next step: free some, or set TMPDIR to a folder on a larger disk"
            )

    def in_batches(self, items: Sequence[Item], size: int, what: str, unit: str) -> Iterator[Sequence[Item]]:
        """Yield ``items`` in slices of ``size``; show progress in items. UserError before one for which the disk is full."""
        for index, _ in enumerate(track(items, what, unit=unit)):
            if index % size == 0:
                self.check_free_space()
                yield items[index : index + size]

    def frame_of(self, name: str) -> int:
        """The frame of the image ``name``."""
        return int(Path(name).stem)

    def write_images(self, images: Iterable[NDArray[np.uint8]], camera: Camera) -> None:
        """Write (H, W, 3) uint8 RGB images as PNG files; ValueError if one does not have the camera's size."""
        for index, image in enumerate(track(images, "COLMAP: writing images")):
            self.check_free_space()
            if image.shape != (camera.height, camera.width, 3) or image.dtype != np.uint8:
                raise ValueError(f"image {index} is {image.shape} {image.dtype}, unlike its camera {camera}")
            name = f"{index:06d}.png"
            bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
            _write_png(self.images / name, bgr)
            self.names.append(name)

    def write_masks(self, valid: NDArray[np.bool_], shown: Iterable[NDArray[np.bool_]] | None) -> None:
        """Write the mask of all images unless every pixel is valid, and of each; features are found inside only."""
        if not valid.all():
            _write_png(self.mask, _shrunk(valid))
        if shown is None:
            return
        self.masks.mkdir()
        for name, mask in zip(self.names, shown, strict=True):
            self.check_free_space()
            # COLMAP appends the suffix to the whole name.
            _write_png(self.masks / f"{name}.png", _shrunk(mask))

    def mask_of(self, name: str) -> NDArray[np.uint8] | None:
        """(H, W) mask of an image, 0 where no features are found; None if they are everywhere."""
        path = self.masks / f"{name}.png" if self.masks.exists() else self.mask
        return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.exists() else None

    def import_images(self, camera: Camera, camera_known: bool) -> None:
        """Enter the images in order, and their camera; an unknown camera is marked as a guess."""
        pycolmap.Database.open(self.database).close()
        pycolmap.import_images(
            self.database, self.images, pycolmap.CameraMode.SINGLE, self.names, self._reader(camera)
        )
        if camera_known:
            return
        # COLMAP trusts a given focal length; a guess must be refined.
        with pycolmap.Database.open(self.database) as database:
            (entered,) = database.read_all_cameras()
            entered.has_prior_focal_length = False
            database.update_camera(entered)

    def extract(self, camera: Camera, threads: int) -> NDArray[np.int64]:
        """Extract SIFT features: (F,) int64 number of them in each image."""
        # The images are in the database already, so their ids do not depend on the order of the threads.
        options = pycolmap.FeatureExtractionOptions(num_threads=threads)
        for names in self.in_batches(self.names, _IMAGES_PER_BATCH, "COLMAP: extracting features", "image"):
            pycolmap.extract_features(
                self.database,
                self.images,
                names,
                pycolmap.CameraMode.SINGLE,
                self._reader(camera),
                options,
                pycolmap.Device.cpu,
            )
        with pycolmap.Database.open(self.database) as database:
            images = sorted(database.read_all_images(), key=lambda image: image.name)
            return np.array(
                [database.num_keypoints_for_image(image.image_id) for image in images], dtype=np.int64
            )

    def set_camera(self, camera: pycolmap.Camera) -> None:
        """Replace the images' camera by one of another model, as a guess."""
        with pycolmap.Database.open(self.database) as database:
            (entered,) = database.read_all_cameras()
            camera.camera_id, camera.has_prior_focal_length = entered.camera_id, False
            database.update_camera(camera)

    def _reader(self, camera: Camera) -> pycolmap.ImageReaderOptions:
        options = pycolmap.ImageReaderOptions(camera_model="PINHOLE")
        options.camera_params = ", ".join(
            repr(float(x)) for x in (camera.fx, camera.fy, camera.cx, camera.cy)
        )
        if self.mask.exists():
            options.camera_mask_path = self.mask
        if self.masks.exists():
            options.mask_path = self.masks
        return options


def _shrunk(shown: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A mask of 0 and 255, without the pixels near its edge."""
    # The edge of the lens circle is a strong feature that moves with the camera, so the region is shrunk.
    margin = max(2, round(shown.shape[0] * _MASK_MARGIN))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    # The border of the image is not such an edge.
    return cv2.erode(shown.astype(np.uint8) * 255, kernel, borderValue=255)


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    # Low compression: the file is read once and deleted.
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
        raise UserError(f"{path}: cannot be written. Is the disk of the temporary folder full?")


def check_features(counts: NDArray[np.int64]) -> None:
    """Raise UserError unless at least three images have enough features, by their (F,) int64 numbers."""
    sufficient = int((counts >= MIN_FEATURES).sum())
    if sufficient < MIN_IMAGES:
        raise UserError(
            f"COLMAP finds too little texture: {sufficient} of {len(counts)} frames have {MIN_FEATURES}"
            f" features or more (median {int(np.median(counts))}, maximum {counts.max()}); use sharper, brighter"
            " or larger frames"
        )


@contextlib.contextmanager
def quiet_colmap() -> Iterator[None]:
    """Silence COLMAP's log, which has a line for every image and pair."""
    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = _FATAL_ONLY
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before


@contextlib.contextmanager
def open_project(
    prefix: str,
    images: Iterable[NDArray[np.uint8]],
    camera: Camera,
    valid: NDArray[np.bool_],
    shown: Iterable[NDArray[np.bool_]] | None,
) -> Iterator[Project]:
    """A project of images and their masks in a temporary folder of a prefix, with COLMAP's log silent.

    ``images`` are (H, W, 3) uint8 RGB; ``valid`` and ``shown`` (H, W) bool are the pixels that show the scene in all and in each.
    UserError if there are fewer than ``MIN_IMAGES``, the camera stands still, or the disk is full.
    """
    with scratch_directory(prefix) as folder, quiet_colmap():
        project = Project(folder)
        project.write_images(images, camera)
        if (count := len(project.names)) < MIN_IMAGES:
            raise UserError(f"COLMAP needs {MIN_IMAGES} frames or more, not {count}: use more frames")
        project.write_masks(valid, shown)
        check_camera_moves(project.images, project.names, project.mask_of)
        yield project
