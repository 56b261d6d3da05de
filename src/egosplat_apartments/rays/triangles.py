"""Ray casting against a set of triangles."""

import ctypes
import weakref

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.arrays import Floats, Ints
from egosplat_apartments.rays.library import load


class Triangles:
    """A set of triangles for ray casting; hits are equal to the last bit on every processor.

    A ray exactly through a shared edge or corner hits one of the triangles there. Among hits at the same
    distance, the face with the smallest number wins.
    """

    def __init__(self, vertices: Floats, faces: Ints, library: ctypes.CDLL | None = None) -> None:
        """Build a tree of bounding boxes around the triangles.

        Args:
            vertices: (V, 3) float32; faces: (F, 3) int32 numbers of vertices.
            library: the compiled ray caster; None for the installed one.

        Raises:
            UserError: the ray caster is not compiled.
            ValueError: an array has a wrong shape or dtype, or a face names a missing vertex.
            MemoryError: the system is out of memory.
        """
        vertices, faces = _checked(vertices, np.float32), _checked(faces, np.int32)
        if len(faces) and not (0 <= faces.min() and faces.max() < len(vertices)):
            raise ValueError(f"faces name vertices {faces.min()} to {faces.max()} of {len(vertices)}")
        self._library = library or load()
        self._tree = self._library.rays_build(vertices.ctypes.data, faces.ctypes.data, len(faces))
        if not self._tree:
            raise MemoryError(f"no memory for {len(faces)} triangles")
        # Unlike __del__, a finalizer also runs if the interpreter exits.
        weakref.finalize(self, self._library.rays_free, self._tree)

    def cast(self, origins: Floats, directions: Floats) -> tuple[Ints, Floats, Floats, Floats]:
        """Find the first hit of each ray.

        Args:
            origins: (N, 3) or (3,) float32; directions: (N, 3) float32, of any length except 0.

        Returns:
            (N,) int32 face, -1 for none; (N,) float32 distance in units of the direction's length, infinite for
            none; two (N,) float32 barycentric weights of the face's second and third corner at the hit.
        """
        origins, directions, stride = _rays(origins, directions)
        face = np.empty(len(directions), dtype=np.int32)
        distance, u, v = (np.empty(len(directions), dtype=np.float32) for _ in range(3))
        outputs = (array.ctypes.data for array in (face, distance, u, v))
        self._library.rays_cast(
            self._tree, len(directions), origins.ctypes.data, stride, directions.ctypes.data, *outputs
        )
        return face, distance, u, v

    def blocks(self, origins: Floats, directions: Floats, reach: Floats) -> NDArray[np.bool_]:
        """(N,) bool: whether rays, given as for ``cast``, hit anything within (N,) float32 distances."""
        origins, directions, stride = _rays(origins, directions)
        reach = np.ascontiguousarray(reach, dtype=np.float32)
        # NumPy's bool has the size of C++'s.
        blocked = np.empty(len(directions), dtype=np.bool_)
        pointers = (array.ctypes.data for array in (directions, reach, blocked))
        self._library.rays_blocked(self._tree, len(directions), origins.ctypes.data, stride, *pointers)
        return blocked


def _checked(array: NDArray, dtype: type) -> NDArray:
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"shape {array.shape}, not (N, 3)")
    if array.dtype != dtype:
        raise ValueError(f"{array.dtype}, not {np.dtype(dtype)}")
    return np.ascontiguousarray(array)


def _rays(origins: Floats, directions: Floats) -> tuple[Floats, Floats, int]:
    """Contiguous rays, and the stride from one origin to the next in numbers; 0 for a shared origin."""
    directions = _checked(np.asarray(directions, dtype=np.float32), np.float32)
    origins = np.asarray(origins, dtype=np.float32)
    if origins.ndim == 1:
        return np.ascontiguousarray(origins), directions, 0
    if origins.shape != directions.shape:
        raise ValueError(f"{len(origins)} origins for {len(directions)} directions")
    return np.ascontiguousarray(origins), directions, 3
