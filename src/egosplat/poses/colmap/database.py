"""COLMAP's first steps: the pictures on disk, their one camera, and their SIFT features in the database."""

import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.progress import track

Item = TypeVar("Item")

FEATURES_WANTED = 50
"""A picture with fewer features than this has too little texture to be registered."""

_PICTURES_AT_A_TIME = 8
_ROOM_BYTES = 2**25
"""More than a step takes: 8 pictures of 8,192 features of 152 bytes, or 100 pairs of 8,192 matches of 16, twice in SQLite."""

_MASK_MARGIN = 0.01
"""Of the picture's height: how far features keep away from the edge of what shows the scene."""


class Project:
    """The files of one run of COLMAP in ``folder``, and the names of its pictures in order of the frames."""

    def __init__(self, folder: Path) -> None:
        self.database = folder / "database.db"
        self.images = folder / "images"
        self.mask = folder / "mask.png"
        self.pairs = folder / "pairs.txt"
        self.vocabulary = folder / "vocabulary.bin"
        self.models = folder / "models"
        self.names: list[str] = []
        self.images.mkdir()
        self.models.mkdir()

    def check_room(self) -> None:
        """Check that the disk has room for the next step; where SQLite finds none, COLMAP takes the whole process down.

        Raises:
            UserError: it has not.
        """
        if (free := shutil.disk_usage(self.images).free) < _ROOM_BYTES:
            raise UserError(
                f"{self.images.parent.parent}: {free >> 20} MiB are left, and COLMAP needs {_ROOM_BYTES >> 20} for its next "
                "step: make room there, or set TMPDIR to a folder on a larger disk"
            )

    def in_batches(self, items: Sequence[Item], size: int, what: str, unit: str) -> Iterator[Sequence[Item]]:
        """Yield ``items`` in slices of ``size``, for each of which there is room, while showing the progress in items.

        Raises:
            UserError: there is no room for the next.
        """
        for index, _ in enumerate(track(items, what, unit=unit)):
            if index % size == 0:
                self.check_room()
                yield items[index : index + size]

    def frame_of(self, name: str) -> int:
        """The frame that the picture ``name`` shows."""
        return int(Path(name).stem)

    def write_pictures(self, pictures: Iterable[NDArray[np.uint8]], camera: Camera) -> None:
        """Write each (H, W, 3) uint8 RGB picture as a PNG file.

        Raises:
            ValueError: a picture does not have the camera's size.
        """
        for index, picture in enumerate(track(pictures, "COLMAP: writing pictures")):
            self.check_room()
            if picture.shape != (camera.height, camera.width, 3) or picture.dtype != np.uint8:
                raise ValueError(
                    f"picture {index} is {picture.shape} {picture.dtype}, unlike its camera {camera}"
                )
            name = f"{index:06d}.png"
            bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
            _write_png(self.images / name, bgr)
            self.names.append(name)

    def write_mask(self, valid: NDArray[np.bool_]) -> None:
        """Write the mask of all pictures, where 0 means no features, if there is anything to mask.

        The valid region is shrunk, for the edge of the lens circle is a strong feature that moves with the
        camera.
        """
        if valid.all():
            return
        margin = max(2, round(valid.shape[0] * _MASK_MARGIN))
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
        # The picture's own border is no such edge: what lies outside of it does not erode it.
        shrunk = cv2.erode(valid.astype(np.uint8) * 255, kernel, borderValue=255)
        _write_png(self.mask, shrunk)

    def import_pictures(self, camera: Camera, camera_known: bool) -> None:
        """Enter the pictures, in order, and their camera; an unknown one is entered as a first guess only."""
        pycolmap.Database.open(self.database).close()
        pycolmap.import_images(
            self.database, self.images, pycolmap.CameraMode.SINGLE, self.names, self._reader(camera)
        )
        if camera_known:
            return
        with pycolmap.Database.open(self.database) as database:
            (entered,) = database.read_all_cameras()
            entered.has_prior_focal_length = False
            database.update_camera(entered)

    def extract(self, camera: Camera, threads: int) -> NDArray[np.int64]:
        """Find SIFT features.

        Returns:
            (F,) int64: number of features of each picture.
        """
        # The pictures are in the database already, so their ids do not depend on which thread ends first.
        options = pycolmap.FeatureExtractionOptions(num_threads=threads)
        for names in self.in_batches(
            self.names, _PICTURES_AT_A_TIME, "COLMAP: extracting features", "picture"
        ):
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

    def _reader(self, camera: Camera) -> pycolmap.ImageReaderOptions:
        options = pycolmap.ImageReaderOptions(camera_model="PINHOLE")
        options.camera_params = ", ".join(
            repr(float(x)) for x in (camera.fx, camera.fy, camera.cx, camera.cy)
        )
        if self.mask.exists():
            options.camera_mask_path = self.mask
        return options


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    # Little compression: the file is read once and thrown away.
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
        raise UserError(f"{path} cannot be written: is the disk of the temporary folder full?")


def check_features(counts: NDArray[np.int64]) -> None:
    """Refuse pictures without texture.

    Args:
        counts: (F,) int64 features of each picture.

    Raises:
        UserError: fewer than three pictures have features enough.
    """
    rich = int((counts >= FEATURES_WANTED).sum())
    if rich < 3:
        raise UserError(
            f"COLMAP finds too little texture: {rich} of {len(counts)} pictures have {FEATURES_WANTED}"
            f" features or more (median {int(np.median(counts))}, most {counts.max()}); use sharper, brighter"
            " or larger pictures"
        )
