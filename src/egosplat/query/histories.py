"""The history of what a query means (docs/method.md#carries), and held-out frames at their own time."""

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.exposure import expose
from egosplat.gaussians.io import read_exposure
from egosplat.geometry import Array
from egosplat.histories.known import Histories, Rests
from egosplat.histories.told import Carried
from egosplat.query.grades import other_meanings
from egosplat.query.relevancy import relevancy
from egosplat.query.scene import TrainedScene
from egosplat.query.text import CARRIED, Texts

# Relevancy from which a thing may be what a query means: it is as like the query as the most alike canonical phrase.
FITS = 0.5


def find_history(histories: Histories, query: Texts, words: Texts, temperature: float) -> tuple[Carried, ...]:
    """Find the carries of the thing that fits one query best, in the order of time.

    No word with another meaning, of what people carry, fits it better, and the query fits it as well as every canonical
    phrase. What stays has no carries; ``words`` are names of things, of which those of what people carry compete.
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
    return tuple(replace(one, score=float(score)) for one in histories.things[int(best)])


@torch.no_grad()
def held_out_at(
    scene: TrainedScene, rests: Rests, splats: Artifact, frame: int, pose: Array, second: float
) -> NDArray[np.uint8] | None:
    """(H, W, 3) render of a held-out frame at its time as the stage ``splats`` makes it, with the gains that it fitted if it
    corrects any; None where nothing rests then."""
    if (now := scene.at(rests, second)) is scene:
        return None
    log_gain, compression = read_exposure(splats)
    colors = now.rendered(now.camera, pose)
    if log_gain is not None:
        colors = expose(colors, log_gain[frame], compression)
    return (colors.clamp(0.0, 1.0) * 255.0).round().to(torch.uint8).cpu().numpy()
