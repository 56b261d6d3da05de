"""Trained scenes: Gaussians with their render settings, the codes and instances that queries need, and viewpoints."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import KDTree
from torch import Tensor

from egosplat.arrays import Array, Bools, Floats, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.gaussians.io import read_trained_scene
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import TrainedScene
from egosplat.geometry import Camera, is_rigid
from egosplat.histories.known import Rests
from egosplat.histories.told import read_second
from egosplat.language.decoder import Decoder, read_decoder
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import Kept, relevancy_maps
from egosplat.query.sizes import Sizes
from egosplat.query.text import AT_ONCE, Texts

# A Gaussian farther from every Gaussian that instances were merged on, in units of their median distance to these, is in no instance.
_FAR = 8.0

# A (4, 4) camera_to_world, or a JSON file {"camera_to_world": 4 rows of 4 numbers}.
Pose = Array | Path | str


@dataclass(frozen=True, eq=False)
class QueryScene(TrainedScene):
    """A trained scene whose Gaussians have a code and a share, (N, L, C) and (N, L) float32 on their device, at L levels;
    of ``maps_only`` codes see ``egosplat.language.method.Coded``. ``sizes`` are evidence for names, if they are known."""

    code: Tensor
    share: Tensor
    decoder: Decoder
    levels: Sequence[str]
    maps_only: bool = False
    sizes: Sizes | None = None
    _kept: Kept = field(default_factory=dict, init=False)

    def at(self, rests: Rests | None, second: float | None) -> "TrainedScene":
        """The scene with what lies there at a time [s], to render its colors; itself if nothing does, or without a time."""
        if rests is None or second is None or not len(added := rests.at(second)):
            return self
        every = Gaussians.concatenate([self.gaussians, rests.gaussians.select(added)])
        return TrainedScene(every, self.settings, self.camera, self.sh_degree)

    def relevancy(self, texts: Texts, options: QueryOptions) -> Tensor:
        """(Q, L, N) float32 in [0, 1]: relevancy of each Gaussian's own code to all queries; 0 without a code."""
        # An image of one level, with a row for each Gaussian and a column for each of its codes, as they lie in memory.
        seen, few = self.share[None] > 0, self.share.numel() * self.decoder.folded[0].widths[-1] <= AT_ONCE
        how = texts, options.temperature, self._kept if few else None
        maps = relevancy_maps(self.code[None], seen, self.decoder, *how)
        found = maps[:, 0].transpose(1, 2).contiguous()
        if self.sizes is None or not options.size_weight:
            return found
        return self.sizes.weigh(found, texts.phrases, options.size_weight)

    def of_level(self, level: int) -> "QueryScene":
        """The scene with the codes of one level."""
        code, share, levels = self.code[:, [level]], self.share[:, [level]], [self.levels[level]]
        sizes = self.sizes and replace(self.sizes, instance=self.sizes.instance[:, [level]])
        return replace(self, code=code, share=share, levels=levels, sizes=sizes)


def read_scene(splats: Artifact, language: Artifact, encoded: Artifact, backend: str) -> QueryScene:
    """Read what a query needs; ``encoded`` are the features or tiles that codes were learnt from. Raises as ``read_trained_scene``."""
    trained = read_trained_scene(splats, backend)
    device = trained.gaussians.means.device
    return QueryScene(
        **vars(trained),
        code=torch.from_numpy(language.read("code")).to(device),
        share=torch.from_numpy(language.read("share")).to(device),
        decoder=read_decoder(language if language.has("decoder/values") else encoded),
        levels=language.facts["levels"],
        maps_only=language.facts.get("maps_only", False),
    )


def rendering_camera(camera: Camera, resolution: int) -> Camera:
    """Scale a camera down to a longer side of ``resolution`` [px]; 0, or more than its own, changes nothing."""
    longer = max(camera.width, camera.height)
    # Codes have no more detail than the frames that they were trained on.
    if not 0 < resolution < longer:
        return camera
    width, height = (max(1, round(side * resolution / longer)) for side in (camera.width, camera.height))
    return camera.scaled_to(width, height)


def instances_of_gaussians(instances: Artifact, means: Floats) -> Ints32:
    """(L, N) int32 instance at each level, -1 for none, of the Gaussian on which masks were merged nearest to each of (N, 3) centers,
    N > 0 (UserError: instances are tracks, which have no place in 3D)."""
    xyz, owner = instances.read("gaussians/xyz"), instances.read("gaussians/instance")
    if not len(xyz):
        what = "its instances are tracks, which have no place in 3D; set instances.source to masks"
        raise UserError(f"{instances.path}: {what}")
    distance, nearest = KDTree(xyz).query(means)
    return np.where((distance <= _FAR * np.median(distance))[:, None], owner[nearest], -1).T


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A (4, 4) float64 pose of the recording's camera, OpenCV axes, meters, with the (H, W) bool pixels that show the scene, or
    None for all; at ``second`` [s since the first frame] it shows what lies there then, too."""

    name: str
    camera_to_world: Array
    valid: Bools | None
    second: float | None = None

    @staticmethod
    def read(pose: Pose, second: float | None = None) -> "Viewpoint":
        """The viewpoint of a pose, named like its file, at a time or of none (UserError: no file, or no rigid motion)."""
        is_file = isinstance(pose, str | Path)
        name, where = (Path(pose).name, f"pose {pose}") if is_file else ("a pose", "pose")
        try:
            matrix = np.array(read_json(Path(pose))["camera_to_world"] if is_file else pose, np.float64)
        except FileNotFoundError:
            raise UserError(f"{where}: does not exist") from None
        except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
            reason, wanted = str(error).partition("\n")[0], "4x4 numbers"
            wanted = f"JSON with {wanted} camera_to_world" if is_file else wanted
            raise UserError(f"{where}: is not {wanted} ({reason})") from None
        if matrix.shape != (4, 4) or not is_rigid(matrix):
            what = "camera_to_world is not a rigid motion: a 4x4 rotation and translation, last row 0 0 0 1"
            raise UserError(f"{where}: {what}")
        if (far := np.abs(matrix).max()) > 1e18:  # float32 holds its square
            raise UserError(f"{where}: is {far:.0e} from the origin, at most 1e+18")
        return Viewpoint(name, matrix, None, None if second is None else read_second(second))
