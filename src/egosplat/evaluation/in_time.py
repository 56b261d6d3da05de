"""Score renders of held-out frames at their own time: with what lies there then, on top of what stays (docs/method.md#own-time)."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from egosplat.artifacts.frames import seconds_of
from egosplat.evaluation.evaluation_frames import Evaluation, Frame
from egosplat.evaluation.rendering import Picture, RegionScore
from egosplat.gaussians.evaluation import rendered
from egosplat.gaussians.training_views import Views
from egosplat.query.rests import Rests, scene_at
from egosplat.query.scene import TrainedScene


def score_in_time(
    evaluation: Evaluation,
    scene: TrainedScene,
    rests: Rests,
    stored: Sequence[Mapping[str, RegionScore]],
) -> list[Mapping[str, RegionScore]]:
    """Scores of the render of each evaluation frame at its time; where nothing rests then, those of the ``stored`` render hold."""
    seconds = seconds_of(evaluation.frames_artifact)
    found = []
    for frame, score in zip(evaluation.frames, stored, strict=True):
        now = scene_at(scene, rests, float(seconds[frame.index]))
        is_stored = now is scene or frame.held_out is None
        found.append(score if is_stored else evaluation.rendering_of(frame, _picture(evaluation, frame, now)))
    return found


@torch.no_grad()
def _picture(evaluation: Evaluation, frame: Frame, scene: TrainedScene) -> Picture:
    """(H, W, 3) uint8 render of a held-out frame, as the stage ``splats`` makes it."""
    shown = rendered(scene.gaussians, _view(evaluation, frame, scene), 0, scene.settings, scene.sh_degree)
    return (shown * 255.0).round().to(torch.uint8).cpu().numpy()


def _view(evaluation: Evaluation, frame: Frame, scene: TrainedScene) -> Views:
    """The view of a held-out frame, with the gains that the stage ``splats`` fitted if it corrects any; without its photograph."""
    splats, row, log_gain, compression = evaluation.splats, [frame.index], None, None
    if splats.has("corrections/gain"):
        log_gain = torch.from_numpy(splats.read("corrections/gain")[row]).log()
        compression = torch.tensor([splats.facts["highlight_compression"]], dtype=torch.float64)
    return Views(
        frame=np.array(row),
        pictures=torch.empty(0),
        camera_to_world=evaluation.camera_to_world[row],
        valid=None,
        transient=None,
        camera=scene.camera,
        device=scene.gaussians.means.device,
        log_gain=log_gain,
        compression=compression,
    )
