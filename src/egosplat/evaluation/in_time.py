"""Score renders of held-out frames at their own time: with what lies there then, on top of what stays (docs/method.md#own-time)."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.schemas import seconds_of
from egosplat.evaluation.evaluation_frames import Evaluation, Frame
from egosplat.evaluation.rendering import Picture, RegionScore
from egosplat.gaussians.evaluation import rendered
from egosplat.gaussians.io import read_exposure
from egosplat.gaussians.training_views import Views
from egosplat.histories.known import Rests
from egosplat.query.histories import scene_at
from egosplat.query.scene import TrainedScene

# As ``read_exposure`` returns it.
Exposure = tuple[Tensor | None, Tensor | None]


def score_in_time(
    evaluation: Evaluation,
    scene: TrainedScene,
    rests: Rests,
    stored: Sequence[Mapping[str, RegionScore]],
) -> list[Mapping[str, RegionScore]]:
    """Scores of the render of each evaluation frame at its time; where nothing rests then, those of the ``stored`` render hold."""
    seconds, exposure = seconds_of(evaluation.frames_artifact), read_exposure(evaluation.splats)
    found = []
    for frame, score in zip(evaluation.frames, stored, strict=True):
        now = scene_at(scene, rests, float(seconds[frame.index]))
        is_stored = now is scene or frame.held_out is None
        found.append(
            score if is_stored else evaluation.rendering_of(frame, _picture(evaluation, frame, now, exposure))
        )
    return found


@torch.no_grad()
def _picture(evaluation: Evaluation, frame: Frame, scene: TrainedScene, exposure: Exposure) -> Picture:
    """(H, W, 3) uint8 render of a held-out frame, as the stage ``splats`` makes it."""
    view = _view(evaluation, frame, scene, exposure)
    shown = rendered(scene.gaussians, view, 0, scene.settings, scene.sh_degree)
    return (shown * 255.0).round().to(torch.uint8).cpu().numpy()


def _view(evaluation: Evaluation, frame: Frame, scene: TrainedScene, exposure: Exposure) -> Views:
    """The view of a held-out frame, with the gains that the stage ``splats`` fitted if it corrects any; without its photograph."""
    row, (log_gain, compression) = [frame.index], exposure
    return Views(
        frame=np.array(row),
        pictures=torch.empty(0),
        camera_to_world=evaluation.camera_to_world[row],
        valid=None,
        transient=None,
        camera=scene.camera,
        device=scene.gaussians.means.device,
        log_gain=None if log_gain is None else log_gain[row],
        compression=compression,
    )
