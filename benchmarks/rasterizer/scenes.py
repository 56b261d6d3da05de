"""Scenes of the benchmark: Gaussians on the surfaces of a furnished room, seen from inside it.

Nothing is downloaded or trained. About 40 Gaussians contribute to a pixel, as in a trained scene, because sizes follow the
spacing and opacities are bimodal.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference.projection import project

Array = NDArray[np.float64]

# Number of Gaussians, width and height [px] of each scene.
SCENES = {"A": (10_000, 320, 240), "B": (50_000, 320, 240), "C": (10_000, 640, 480), "D": (50_000, 640, 480)}

NEAR_PLANE, EPS2D = 0.1, 0.3

_ROOM = (5.0, 5.0, 2.7)
_PIECES, _ON_TABLES = 14, 7
_FEATURES = 9
_CAMERAS = 8
_FIELD_OF_VIEW = 75.0


@dataclass(frozen=True)
class Scene:
    """Gaussians and cameras, float32.

    Attributes:
        means: (N, 3) [m]; quats: (N, 4) wxyz; scales: (N, 3) [m]; opacities: (N,).
        colors: (N, 3) in [0, 1]; features: (N, 9).
        viewmats: (8, 4, 4) world_to_camera.
        K: (3, 3) [px], of all cameras.
        width, height: image size [px].
    """

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    colors: Tensor
    features: Tensor
    viewmats: Tensor
    K: Tensor
    width: int
    height: int


@dataclass(frozen=True)
class Problem:
    """Input of a rasterizer: Gaussians projected into the first camera, without culled ones.

    Attributes:
        means2d: (M, 2) [px]; conics: (M, 3); depths: (M,) [m]; opacities: (M,); channels: (M, X).
        radii: (M, 2) int32 [px].
        v_render: (H, W, X) gradient of the loss to the image; planar in memory, as the loss returns it.
    """

    means2d: Tensor
    conics: Tensor
    depths: Tensor
    opacities: Tensor
    channels: Tensor
    radii: Tensor
    v_render: Tensor

    @property
    def height(self) -> int:
        return self.v_render.shape[0]

    @property
    def width(self) -> int:
        return self.v_render.shape[1]


def make_scene(gaussians: int, width: int, height: int, seed: int = 0) -> Scene:
    """A room of 5 x 5 x 2.7 m with 14 boxes: discs as large as their spacing, denser on the boxes."""
    rng = np.random.default_rng(seed)
    corner, u, v = _surfaces(rng)
    sides = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
    area = sides[0] * sides[1]
    # Densification makes objects denser than walls.
    share = area * np.where(np.arange(len(area)) < 6, 1.0, 4.0)
    share /= share.sum()
    surface = rng.choice(len(area), size=gaussians, p=share)
    normals = np.cross(u, v) / area[:, None]
    along_u, along_v = rng.random((gaussians, 1)), rng.random((gaussians, 1))
    means = corner[surface] + along_u * u[surface] + along_v * v[surface]
    means += normals[surface] * rng.normal(0.0, 0.01, (gaussians, 1))
    spacing = np.sqrt(area / (gaussians * share))[surface]
    scales = _scales(rng, spacing)
    quats = _quats(rng, (u / sides[0][:, None])[surface], normals[surface])
    opacities = _opacities(rng, gaussians)
    colors, features = _appearance(rng, means, surface, len(area))
    focal = 0.5 * width / np.tan(np.radians(_FIELD_OF_VIEW) / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    arrays = (means, quats, scales, opacities, colors, features, _viewmats(rng), K)
    return Scene(*(torch.from_numpy(array).float() for array in arrays), width, height)


def channels(scene: Scene, count: int) -> Tensor:
    """(N, count): the colors, then the features, repeated."""
    known = torch.cat([scene.colors, scene.features], dim=1)
    return known[:, torch.arange(count) % known.shape[1]].contiguous()


def make_problem(scene: Scene, count: int) -> Problem:
    """The scene in its first camera with ``count`` channels."""
    gaussians = scene.means, scene.quats, scene.scales, scene.opacities, scene.colors
    camera = scene.viewmats[:1], scene.K[None], scene.width, scene.height
    projected = project(Arguments(*gaussians, *camera, near_plane=NEAR_PLANE, eps2d=EPS2D), 0)
    seen = (projected.radii > 0).all(dim=1)
    parts = (projected.means2d, projected.conics, projected.depths, projected.opacities)
    generator = torch.Generator().manual_seed(0)
    return Problem(
        *(part[seen].contiguous() for part in parts),
        channels=channels(scene, count)[seen].contiguous(),
        radii=projected.radii[seen].contiguous(),
        v_render=torch.randn(count, scene.height, scene.width, generator=generator).permute(1, 2, 0),
    )


def _surfaces(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Corner and both sides, (R, 3) each, of all rectangles: the room's six first."""
    boxes = [(np.array([-_ROOM[0] / 2, -_ROOM[1] / 2, 0.0]), np.array(_ROOM))]
    for piece in range(_PIECES):
        size = np.array([rng.uniform(0.15, 0.9), rng.uniform(0.15, 0.9), rng.uniform(0.1, 1.0)])
        on_floor = piece < _PIECES - _ON_TABLES
        place = [rng.uniform(-2.2, 1.6), rng.uniform(-2.2, 1.6), 0.0 if on_floor else 0.75]
        boxes.append((np.array(place), size if on_floor else 0.35 * size))
    faces = [
        (corner + far * size[axis] * np.eye(3)[axis], *(np.diag(size)[(axis + k) % 3] for k in (1, 2)))
        for corner, size in boxes
        for axis in range(3)
        for far in (0, 1)
    ]
    corners, u, v = (np.stack(part) for part in zip(*faces, strict=True))
    return corners, u, v


def _scales(rng: np.random.Generator, spacing: Array) -> Array:
    size = 0.75 * spacing[:, None] * np.exp(rng.normal(0.0, 0.45, (len(spacing), 1)))
    stretch = np.exp(rng.normal(0.0, 0.5, (len(spacing), 2)))
    return np.concatenate([size * stretch, 0.15 * size], axis=1)


def _quats(rng: np.random.Generator, tangents: Array, normals: Array) -> Array:
    """Discs in their surface with a random rotation about its normal."""
    angle = rng.uniform(0.0, 2 * np.pi, len(normals))[:, None]
    first = np.cos(angle) * tangents + np.sin(angle) * np.cross(normals, tangents)
    axes = np.stack([first, np.cross(normals, first), normals], axis=-1)
    return Rotation.from_matrix(axes).as_quat(scalar_first=True)


def _opacities(rng: np.random.Generator, count: int) -> Array:
    faint = rng.random(count) < 0.45
    low, high = rng.beta(1.2, 6.0, count), rng.beta(4.0, 1.5, count)
    return np.where(faint, low, high).clip(0.01, 0.99)


def _appearance(
    rng: np.random.Generator, means: Array, surface: NDArray[np.int64], surfaces: int
) -> tuple[Array, Array]:
    """Color waves with noise; features that differ between surfaces."""
    waves = rng.normal(0.0, 3.0, (3, 3))
    phases = rng.uniform(0.0, 6.0, (surfaces, 3))[surface]
    colors = 0.5 + 0.35 * np.sin(means @ waves.T + phases) + rng.normal(0.0, 0.05, means.shape)
    of_surface = rng.normal(0.0, 1.0, (surfaces, _FEATURES))[surface]
    features = of_surface + 0.1 * rng.normal(0.0, 1.0, (len(means), _FEATURES))
    return colors.clip(0.02, 0.98), features


def _viewmats(rng: np.random.Generator) -> Array:
    """Cameras on a circle at the height of a head, looking across the room and a little down."""
    angles = 2 * np.pi * np.arange(_CAMERAS) / _CAMERAS
    viewmats = []
    for angle in angles:
        eye = np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 1.6]) + rng.normal(0.0, 0.05, 3)
        target = np.array([-1.2 * np.cos(angle + 0.5), -1.2 * np.sin(angle + 0.5), 0.8])
        viewmats.append(_looking(eye, target))
    return np.stack(viewmats)


def _looking(eye: Array, target: Array) -> Array:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat
