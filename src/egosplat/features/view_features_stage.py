"""Stage ``view_features``: encode each instance with OpenCLIP in each frame that shows it."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES, lies_on_its_side
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.view_features import VIEW_FEATURES
from egosplat.artifacts.writer import create
from egosplat.codes.vectors import usable
from egosplat.errors import UserError
from egosplat.features.crops import (
    InstanceViews,
    channels,
    cut_crops,
    encode,
    find_views,
)
from egosplat.features.options import ViewFeaturesOptions
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.configs import SMALL
from egosplat.models.open_clip_loader import OpenClip, load_open_clip
from egosplat.progress import log, track

# Crops per OpenCLIP batch. The order of sums, and so the last digit, depends on it.
BATCH = 64

Features = NDArray[np.float32]


@dataclass(frozen=True)
class _Inputs:
    frames: Artifact
    instances: Artifact
    clip: OpenClip
    hull: bool


def run(frames_path: Path, instances_path: Path, output: Path, options: ViewFeaturesOptions) -> None:
    """Write the view features of ``instances``.

    A killed run resumes from its last checkpoint and gives identical features.

    Raises:
        UserError: the inputs do not belong together, the model cannot be loaded, or it gives no finite feature.
    """
    frames, instances = open_artifact(frames_path, FRAMES), open_artifact(instances_path, INSTANCES)
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    used = (options.clip_model, options.clip_checkpoint)
    inputs = _Inputs(
        frames, instances, load_open_clip(*used, options.device, options.precision), options.hull
    )
    model = _model_facts(inputs.clip, *used)
    record = provenance.begin_from(
        "view_features",
        options.as_dict(),
        (frames, instances),
        {CLIP.checkpoint_key: model["hash"]},
    )
    views = find_views(frames, instances, options.min_area, options.max_views)
    # The key holds the device and the precision, too: their features differ in the last bits.
    checkpoint = Checkpoint(output, provenance.key_of(record, model))
    features = _encoded(inputs, views, BATCH, checkpoint)
    good = _checked(features, options.clip_checkpoint)
    facts = {
        "levels": instances.facts["levels"],
        "clip": model,
        "without_feature": int((~good).sum()),
        "turned": lies_on_its_side(frames),
    }
    _write(output, record, views.chosen(good), features[good], instances.read("instances/level"), facts)
    checkpoint.remove()
    seen, count = len(np.unique(views.instance[good])), instances.shape("instances/level")[0]
    log(f"{int(good.sum())} views of {seen} of {count} instances")


def _model_facts(clip: OpenClip, model: str, checkpoint: str) -> dict[str, Any]:
    """Describe the model: equal descriptions mean equal features."""
    return {
        "model": model,
        "checkpoint": checkpoint,
        "hash": model_hash(CLIP, {CLIP.config_key: model, CLIP.checkpoint_key: checkpoint}),
        "small": checkpoint == SMALL,
        "device": clip.compute.device.type,
        "dtype": str(clip.compute.dtype).removeprefix("torch."),
    }


def _encoded(inputs: _Inputs, views: InstanceViews, batch: int, checkpoint: Checkpoint) -> Features:
    """(R, D) features in the order of the views; NaN where the model gives none."""
    order = views.by_frame
    saved = checkpoint.load()
    done = [] if saved is None else [saved["features"].numpy()]
    if start := sum(map(len, done)):
        log(f"encoding resumes after crop {start} of {len(views)}")
    left = views.chosen(order[start:])
    for crops in track(_batches(inputs, left, batch), "encoding crops", -(-len(left) // batch), unit="step"):
        done.append(encode(inputs.clip, crops))
        checkpoint.save_if_due(lambda: {"features": torch.from_numpy(np.concatenate(done))})
    features = np.empty((len(views), done[0].shape[1] if done else channels(inputs.clip)), np.float32)
    if done:
        features[order] = np.concatenate(done)
    return features


def _batches(inputs: _Inputs, views: InstanceViews, size: int) -> Iterator[NDArray[np.uint8]]:
    """Yield (B, H, W, 3) crops in the order of the views, ``size`` at a time, across frames."""
    wanted = inputs.clip.preprocessing
    crops = cut_crops(inputs.frames, inputs.instances, views, wanted, hull=inputs.hull)
    while few := list(islice(crops, size)):
        yield np.stack(few)


def _checked(features: Features, checkpoint: str) -> NDArray[np.bool_]:
    """(R,) bool: views with a feature; the number of others is logged."""
    good = usable(features)
    if len(good) and not good.any():
        raise UserError(
            f"models.clip_checkpoint = {checkpoint!r}: the model gives no finite feature for any crop; "
            "use another checkpoint, or set run.precision to float32"
        )
    if lost := int((~good).sum()):
        log(f"warning: {lost} of {len(good)} views are skipped: the model gives no finite feature for them")
    return good


def _write(
    output: Path,
    record: Provenance,
    views: InstanceViews,
    features: Features,
    level: NDArray[np.int8],
    facts: dict[str, Any],
) -> None:
    with create(output, VIEW_FEATURES, record) as artifact:
        for name in ("instance", "frame", "area", "box"):
            artifact.put(name, getattr(views, name))
        artifact.put("feature", features)
        artifact.put("instances/level", level)
        artifact.facts = facts
