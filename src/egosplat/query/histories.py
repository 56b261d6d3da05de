"""A scene at a time, and the history of what a query means (docs/method.md#carries)."""

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.evaluation import rendered
from egosplat.gaussians.io import read_exposure
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Array
from egosplat.histories.known import Histories, Rests
from egosplat.histories.told import Carried
from egosplat.query.grades.evidence import other_meanings
from egosplat.query.relevancy import relevancy
from egosplat.query.scene import QueryScene, TrainedScene
from egosplat.query.text import Texts
from egosplat.query.vocabulary import CARRIED

# Relevancy from which a thing may be what a query means: it is as like the query as the most alike canonical phrase.
FITS = 0.5


def find_history(histories: Histories, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
    """Find the carries of the thing that fits a query best, in the order of time.

    No word with another meaning, of what people carry, fits it better, and the query fits it as well as every canonical
    phrase. What stays has no carries.

    Args:
        query: one phrase.
        words: names of things; those of what people carry compete with it.
        temperature: as in ``relevancy``.
    """
    own = query.queries[0]
    carried = torch.tensor([word in CARRIED for word in words.phrases])
    if not histories.things or not carried[(words.queries @ own).argmax()]:
        return ()
    features, others = histories.features, words.queries[carried & other_meanings(query, words)]
    unnamed = (features @ others.T >= (features @ own)[:, None]).any(dim=1)
    scores = relevancy(features, query.queries, query.canonical, temperature)[:, 0]
    score, best = scores.masked_fill(unnamed, 0.0).max(dim=0)
    if not score > FITS:
        return ()
    return tuple(replace(one, score=float(score)) for one in histories.things[best])


def relevancy_of_rests(rests: Rests, texts: Texts, temperature: float) -> Tensor:
    """(K, Q) float32 in [0, 1]: relevancy of each Gaussian of rests, that of its thing."""
    queries, canonical = (part.to(rests.feature) for part in (texts.queries, texts.canonical))
    of_things = relevancy(rests.feature, queries, canonical, temperature)
    return of_things[torch.from_numpy(rests.thing[rests.rest]).to(of_things.device)]


def scene_at(scene: TrainedScene, rests: Rests | None, second: float | None) -> TrainedScene:
    """A scene with what lies there at a time, to render its colors; the scene itself without a time."""
    if rests is None or second is None or not len(added := rests.at(second)):
        return scene
    every = Gaussians.concatenate([scene.gaussians, rests.gaussians.select(added)])
    return TrainedScene(every, scene.settings, scene.camera, scene.sh_degree)


@torch.no_grad()
def held_out_at(
    scene: TrainedScene, rests: Rests, splats: Artifact, frame: int, pose: Array, second: float
) -> NDArray[np.uint8] | None:
    """(H, W, 3) render of a held-out frame at its time as the stage ``splats`` makes it, with the gains that it fitted if it
    corrects any; None where nothing rests then."""
    if (now := scene_at(scene, rests, second)) is scene:
        return None
    log_gain, compression = read_exposure(splats)
    view = Views(
        frame=np.array([frame]),
        pictures=torch.empty(0),
        camera_to_world=pose[None],
        valid=None,
        transient=None,
        camera=now.camera,
        device=now.gaussians.means.device,
        log_gain=None if log_gain is None else log_gain[[frame]],
        compression=compression,
    )
    shown = rendered(now.gaussians, view, 0, now.settings, now.sh_degree)
    return (shown * 255.0).round().to(torch.uint8).cpu().numpy()


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
