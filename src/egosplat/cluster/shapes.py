"""How large a scene is: the shapes of a job's inputs, from their headers alone."""

import errno
import json
import math
from collections.abc import Iterable
from pathlib import Path

_TOLD_BY = {
    "frames": (("frames", "rgb", slice(0, 1)), ("segments", "labels", slice(0, 1))),
    "pixels": (("frames", "rgb", slice(1, 3)), ("segments", "labels", slice(2, 4))),
    "instances": (("segments", "instances/level", slice(0, 1)),),
    "views": (("view_features", "feature", slice(0, 1)),),
    "channels": (("view_features", "feature", slice(1, 2)),),
    "gaussians": (("splats", "means", slice(0, 1)),),
}
"""Of each size, the artifacts that tell it, the array, and the axes that it is the product of."""


class Shapes:
    """Sizes of a scene as a job's inputs tell them. Each is read when it is asked for, from one JSON file of 1 kB.

    Args:
        paths: the job's inputs; those that say nothing of a scene's size are passed over.

    Raises:
        FileNotFoundError: (on asking) the artifact is still to be made; its ``filename`` is the path as it was given.
        LookupError: (on asking) no input of the job tells that size.
    """

    def __init__(self, paths: Iterable[str]) -> None:
        self._paths = {Path(path).stem: path for path in paths if Path(path).suffix == ".zarr"}

    @property
    def frames(self) -> int:
        """Frames of the recording."""
        return self._size("frames")

    @property
    def pixels(self) -> int:
        """Pixels of a frame."""
        return self._size("pixels")

    @property
    def instances(self) -> int:
        """Instances at all levels together."""
        return self._size("instances")

    @property
    def views(self) -> int:
        """Pairs of an instance and a frame that shows it."""
        return self._size("views")

    @property
    def channels(self) -> int:
        """Channels of a view's feature."""
        return self._size("channels")

    @property
    def gaussians(self) -> int:
        """Gaussians of the scene."""
        return self._size("gaussians")

    def _size(self, name: str) -> int:
        for artifact, array, axes in _TOLD_BY[name]:
            if artifact in self._paths:
                return math.prod(_shape(self._paths[artifact], array)[axes])
        raise LookupError(f"no input of the job tells its {name}: {', '.join(self._paths) or 'none'}")


def _shape(path: str, array: str) -> tuple[int, ...]:
    try:
        header = json.loads((Path(path) / array / "zarr.json").read_text())
    except OSError:
        raise FileNotFoundError(errno.ENOENT, "is still to be made", path) from None
    return tuple(header["shape"])
