"""COLMAP's first step: images on disk, their shared camera, and SIFT features in the database."""

import errno
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pycolmap

from egosplat.arrays import Bools, Bytes
from egosplat.errors import UserError
from egosplat.progress import track

Item = TypeVar("Item")

# Of an image; matching takes time with the square of their number.
_MAX_FEATURES = 4000

# Least contrast of a feature: COLMAP's own, then another for images with fewer than enough features, such as those of a turning
# head. Of 121 frames with hands, all get one model in place of three; half of it doubles the time.
_CONTRASTS, _ENOUGH_FEATURES = (0.02 / 3, 0.002), 1000

# An image with fewer features has too little texture to be registered.
MIN_FEATURES, MIN_IMAGES = 50, 3

_IMAGES_PER_BATCH = 8
# More than a batch writes: 8 images of 4,000 features of 152 bytes, or 100 pairs of 4,000 matches of 16 bytes, twice
# in SQLite.
_MIN_FREE_BYTES = 2**25

# Distance of features from the edge of the valid region, as a fraction of the image height.
_MASK_MARGIN = 0.01


class TooFewError(UserError):
    """There are too few images, or features in them."""


class Project:
    """The files of one COLMAP run in a folder, and the names of its images in the order of the frames.

    ``camera`` is that of all images: kept if it ``has_prior_focal_length``, else a guess that is refined.
    """

    def __init__(self, folder: Path, camera: pycolmap.Camera) -> None:
        self.folder, self.camera = folder, camera
        self.database = folder / "database.db"
        self.images, self.masks = folder / "images", folder / "masks"
        self.names: list[str] = []
        self.images.mkdir()

    def check_free_space(self) -> None:
        """Raise OSError unless the disk has room for the next batch."""
        # COLMAP aborts the whole process if SQLite cannot write. No UserError: nothing is wrong with the frames.
        if (free := shutil.disk_usage(self.folder).free) < _MIN_FREE_BYTES:
            wants = f"{free >> 20} MiB are free, and COLMAP needs {_MIN_FREE_BYTES >> 20} for its next step"
            elsewhere = f"{wants}; TMPDIR may name a folder on a larger disk"
            raise OSError(errno.ENOSPC, elsewhere, str(self.folder.parent))

    def in_batches(self, items: Sequence[Item], size: int, what: str, unit: str) -> Iterator[Sequence[Item]]:
        """Yield ``items`` in slices of ``size``; show progress in items. OSError before one for which the disk is full."""
        for index, _ in enumerate(track(items, what, unit=unit)):
            if index % size == 0:
                self.check_free_space()
                yield items[index : index + size]

    def write_images(self, images: Iterable[Bytes]) -> None:
        """Write (H, W, 3) uint8 RGB images of the camera's size as PNG files; UserError if there are too few."""
        for index, image in enumerate(track(images, "COLMAP: writing images")):
            self.check_free_space()
            assert image.shape == (self.camera.height, self.camera.width, 3) and image.dtype == np.uint8
            self.names.append(f"{index:06d}.png")
            _write_png(self.images / self.names[-1], cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        if (count := len(self.names)) < MIN_IMAGES:
            raise TooFewError(f"COLMAP needs {MIN_IMAGES} frames or more, not {count}: use more frames")

    def write_masks(self, valid: Bools, shown: Iterable[Bools] | None) -> None:
        """Write masks of the (H, W) bool pixels of all images, and of each, that show the scene; others have no features."""
        if valid.all() and shown is None:
            return
        self.masks.mkdir()
        for name, mask in zip(self.names, [valid] * len(self.names) if shown is None else shown, strict=True):
            self.check_free_space()
            _write_png(self.mask_of(name), _shrunk(mask))

    def mask_of(self, name: str) -> Path:
        """The file of an image's mask, 0 where no features are found; it does not exist if they are everywhere."""
        # COLMAP appends the suffix to the whole name.
        return self.masks / f"{name}.png"

    def import_images(self) -> None:
        """Enter the images in order, and their camera."""
        pycolmap.Database.open(self.database).close()
        pycolmap.import_images(
            self.database, self.images, pycolmap.CameraMode.SINGLE, self.names, self._reader()
        )
        # COLMAP trusts every camera that it is given.
        with pycolmap.Database.open(self.database) as database:
            (self.camera.camera_id,) = (entered.camera_id for entered in database.read_all_cameras())
            database.update_camera(self.camera)

    def extract(self, threads: int) -> None:
        """Extract the SIFT features of the images. UserError if too few images have enough."""
        # The images are in the database already, so their ids do not depend on the order of the threads.
        options = pycolmap.FeatureExtractionOptions(num_threads=threads)
        options.sift.max_num_features = _MAX_FEATURES
        poor, counts = self.names, np.empty(0, np.int64)
        for contrast in _CONTRASTS:
            options.sift.peak_threshold = contrast
            self._extract(poor, options)
            with pycolmap.Database.open(self.database) as database:
                images = sorted(database.read_all_images(), key=lambda image: image.name)
                counts = np.array([database.num_keypoints_for_image(image.image_id) for image in images])
            poor = [name for name, count in zip(self.names, counts, strict=True) if count < _ENOUGH_FEATURES]
            if not poor:
                break
        if (sufficient := int((counts >= MIN_FEATURES).sum())) < MIN_IMAGES:
            raise TooFewError(
                f"COLMAP finds too little texture: {sufficient} of {len(counts)} frames have {MIN_FEATURES}"
                f" features or more (median {int(np.median(counts))}, maximum {counts.max()}); use sharper, brighter"
                " or larger frames"
            )

    def _extract(self, names: list[str], options: pycolmap.FeatureExtractionOptions) -> None:
        """Extract features of some images, in place of what they have, if they have too few."""
        # COLMAP passes over images with features, and pycolmap deletes those of all images alone.
        with closing(sqlite3.connect(self.database)) as database, database:
            for table in ("keypoints", "descriptors"):
                database.execute(f"DELETE FROM {table} WHERE rows < {_ENOUGH_FEATURES}")
        single, cpu = pycolmap.CameraMode.SINGLE, pycolmap.Device.cpu
        for batch in self.in_batches(names, _IMAGES_PER_BATCH, "COLMAP: extracting features", "image"):
            pycolmap.extract_features(
                self.database, self.images, list(batch), single, self._reader(), options, cpu
            )

    def _reader(self) -> pycolmap.ImageReaderOptions:
        params = ", ".join(map(repr, self.camera.params.tolist()))
        options = pycolmap.ImageReaderOptions(camera_model=self.camera.model_name, camera_params=params)
        if self.masks.exists():
            options.mask_path = self.masks
        return options


def _shrunk(shown: Bools) -> Bytes:
    """A mask of 0 and 255, without the pixels near its edge."""
    # The edge of the lens circle is a strong feature that moves with the camera, so the region is shrunk.
    margin = max(2, round(shown.shape[0] * _MASK_MARGIN))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    # The border of the image is not such an edge.
    return cv2.erode(shown.astype(np.uint8) * 255, kernel, borderValue=255).astype(np.uint8)


def _write_png(path: Path, image: cv2.typing.MatLike) -> None:
    # Low compression: the file is read once and deleted.
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
        raise OSError(errno.ENOSPC, "cannot be written", str(path))
