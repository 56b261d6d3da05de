"""A scene at a time: what lies somewhere for a while, on top of what stays (docs/method.md#rests)."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_spans
from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Array
from egosplat.query.relevancy import relevancy
from egosplat.query.scene import QueryScene, TrainedScene
from egosplat.query.text import Texts


@dataclass(frozen=True, eq=False)
class Rests:
    """K Gaussians of R rests of T things.

    Attributes:
        gaussians: on the device of the renderer.
        rest: (K,) int64 rest of each.
        thing: (R,) int64 thing of each rest.
        from_s, until_s: (R,) float64 seconds since the first frame, both included.
        feature: (T, D) float32 of unit norm, of each thing; zeros without one.
        absent_s: (2, R) float64 time of the last frame before and the first one after that shows the place without it; NaN without one.
        center: (R, 3) float64 in the world; ``size`` (R,) [m].
        frame: (R,) int64 the frame that shows most of it; ``box`` (R, 4) x0, y0, x1, y1 around it there [px].
        links: (3, C) int32 of each carry: its thing, the rest before and the rest after it, -1 for none.
    """

    gaussians: Gaussians
    rest: NDArray[np.int64]
    thing: NDArray[np.int64]
    from_s: Array
    until_s: Array
    feature: Tensor
    absent_s: Array
    center: Array
    size: Array
    frame: NDArray[np.int64]
    box: NDArray[np.int32]
    links: NDArray[np.int32]

    @staticmethod
    def read(rests: Artifact, seconds: Array, device: torch.device) -> "Rests":
        """Read rests.zarr.

        Args:
            seconds: (F,) float64 time of each frame since the first.

        Raises:
            ArtifactError: a rest lies outside of these frames, or ends before it begins.
        """
        names = ("from_frame", "until_frame", "absent_before", "absent_after", "best_frame")
        frames = {name: rests.read(name) for name in names}
        check_spans(rests, len(seconds), frames)
        first, last, before, after, best = frames.values()
        absent = np.stack([before, after])
        return Rests(
            read_gaussians(rests, "gaussians/").to(device),
            rests.read("gaussians/rest").astype(np.int64),
            rests.read("thing").astype(np.int64),
            seconds[first],
            seconds[last],
            torch.from_numpy(rests.read("things/feature")).to(device),
            np.where(absent < 0, np.nan, seconds[absent]),
            rests.read("center"),
            rests.read("size"),
            best,
            rests.read("box"),
            np.stack([rests.read(f"carries/{name}") for name in ("thing", "from_rest", "to_rest")]),
        )

    def covers(self, second: float) -> NDArray[np.bool_]:
        """(R,) bool: the rests at a time."""
        return (self.from_s <= second) & (second <= self.until_s)

    def at(self, second: float) -> Tensor:
        """(M,) int64 indices of the Gaussians that are there at a time."""
        return torch.from_numpy(np.flatnonzero(self.covers(second)[self.rest])).to(self.feature.device)

    def relevancy(self, texts: Texts, temperature: float) -> Tensor:
        """(K, Q) float32 in [0, 1]: of each Gaussian, that of its thing."""
        given = (part.to(self.feature) for part in (texts.queries, texts.canonical))
        of_things = relevancy(self.feature, *given, temperature)
        return of_things[torch.from_numpy(self.thing[self.rest]).to(of_things.device)]


def scene_at(scene: TrainedScene, rests: Rests | None, second: float | None) -> TrainedScene:
    """A scene with what lies there at a time, to render its colors; the scene itself without a time."""
    if rests is None or second is None or not len(added := rests.at(second)):
        return scene
    every = Gaussians.concatenate([scene.gaussians, rests.gaussians.select(added)])
    return TrainedScene(every, scene.settings, scene.camera, scene.sh_degree)


def relevancies_at(scene: QueryScene, rests: Rests, of_rests: Tensor, second: float) -> QueryScene:
    """A scene whose codes are relevancies to Q queries, with what lies there at a time.

    Args:
        of_rests: (K, Q) relevancy of each Gaussian of ``rests``, for all levels; its share is 1 at each.
    """
    if not len(added := rests.at(second)):
        return scene
    relevancies = of_rests[added][:, None].expand(-1, scene.share.shape[1], -1)
    return replace(
        scene,
        gaussians=Gaussians.concatenate([scene.gaussians, rests.gaussians.select(added)]),
        code=torch.cat([scene.code, relevancies]),
        share=torch.cat([scene.share, scene.share.new_ones(relevancies.shape[:2])]),
    )
