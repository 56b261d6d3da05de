"""Stage ``view_features``: encode each instance with OpenCLIP in each frame that shows it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Bools, Floats
from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Chunks, Work
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, INSTANCES, VIEW_FEATURES, lies_on_its_side
from egosplat.artifacts.writer import create
from egosplat.errors import UserError
from egosplat.features.crops import (
    VIEW,
    InstanceViews,
    channels,
    cut_crops,
    encode,
    find_views,
    join_views,
    split_batches,
)
from egosplat.features.options import ViewFeaturesOptions
from egosplat.language.vectors import usable
from egosplat.models.checkpoints import CLIP, SMALL, model_hash
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.progress import log

# Crops per OpenCLIP batch. The order of sums, and so the last digit, depends on it.
BATCH = 64


@dataclass(frozen=True)
class _Inputs:
    frames: Artifact
    instances: Artifact
    clip: OpenClip
    options: ViewFeaturesOptions

    def find_batches(self, chunks: Chunks) -> list[InstanceViews]:
        """Find the views of chunks of frames, in batches in the order of encoding."""
        options = self.options
        views = find_views(self.frames, self.instances, options.min_area, options.max_views, chunks)
        return split_batches(views[np.lexsort((views.instance, views.frame))], chunks, BATCH)

    def encode_batches(self, batches: list[InstanceViews]) -> Iterator[dict[str, Tensor]]:
        """Yield the (B, 7) views of each batch and their (B, D) features, NaN where the model gives none."""
        views, wanted = join_views(batches), self.clip.preprocessing
        crops = cut_crops(self.frames, self.instances, views, wanted, hull=self.options.cut == "hull")
        for batch in batches:
            features = encode(self.clip, np.stack([*islice(crops, len(batch))]))
            table = np.asarray(batch).view(np.int32).reshape(-1, 7)
            yield {"views": torch.from_numpy(table), "features": torch.from_numpy(features)}


def run(
    frames_path: Path,
    instances_path: Path,
    output: Path,
    options: ViewFeaturesOptions,
    *,
    chunk: int | None = None,
    gather: Sequence[Path] = (),
) -> None:
    """Write the view features of ``instances``.

    A killed run resumes from its last checkpoint and gives identical features. UserError: the inputs do not belong together,
    the model cannot be loaded, it gives no finite feature, or there are chunks and a limit of views.

    Args:
        chunk, gather: as in ``Work``.
    """
    if options.max_views is not None and (chunk or gather):
        raise UserError("view_features.max_views chooses among all frames: give neither --chunk nor --gather")
    frames, instances = open_artifact(frames_path, FRAMES), open_artifact(instances_path, INSTANCES)
    check_made_from(instances, frames, axes=("frame", "height", "width"))
    used = (options.clip_model, options.clip_checkpoint)
    inputs = _Inputs(frames, instances, load_open_clip(*used, options.device, options.precision), options)
    # Equal descriptions mean equal features.
    model = {
        "model": options.clip_model,
        "checkpoint": options.clip_checkpoint,
        "hash": model_hash(CLIP, options.as_dict()),
        "small": options.clip_checkpoint == SMALL,
        "device": inputs.clip.compute.device.type,
        "dtype": str(inputs.clip.compute.dtype).removeprefix("torch."),
    }
    models = {CLIP.checkpoint_key: model["hash"]}
    record = provenance.begin_from("view_features", options.as_dict(), (frames, instances), models)
    # The key holds the device and the precision, too: their features differ in the last bits.
    work = Work(output, record, frames.shape("rgb")[0], chunk, gather, model)
    found = work.results(inputs.find_batches, inputs.encode_batches, "encoding crops", unit="step")
    if found is None:
        return
    views = join_views([part["views"].numpy().view(VIEW)[:, 0] for part in found])
    good = _checked([part["features"].numpy() for part in found], options.clip_checkpoint)
    facts = {
        "levels": instances.facts["levels"],
        "clip": model,
        "without_feature": int((~good).sum()),
        "turned": lies_on_its_side(frames),
    }
    order = np.lexsort((views.frame, views.instance, ~good))[: good.sum()]
    stored, record = views[order], replace(record, gathered=work.costs)
    features, row = np.empty((len(order), channels(inputs.clip)), np.float32), np.full(len(views), -1)
    row[order] = np.arange(len(order))
    # A part goes when its features are put: those of an hour take gigabytes.
    for part in found:
        values = part.pop("features").numpy()
        rows, row = row[: len(values)], row[len(values) :]
        features[rows[rows >= 0]] = values[rows >= 0]
    with create(output, VIEW_FEATURES, record) as artifact:
        for name in ("instance", "frame", "area", "box"):
            artifact.put(name, np.ascontiguousarray(getattr(stored, name)))
        artifact.put("feature", features)
        artifact.put("instances/level", instances.read("instances/level"))
        artifact.facts = facts
    work.finish()
    seen, count = len(np.unique(views.instance[good])), instances.shape("instances/level")[0]
    log(f"{len(order)} views of {seen} of {count} instances")


def _checked(features: Sequence[Floats], checkpoint: str) -> Bools:
    """(R,) bool: views with a feature, of parts of them; the number of others is logged."""
    good = np.concatenate([np.zeros(0, bool), *map(usable, features)])
    if len(good) and not good.any():
        raise UserError(
            f"models.clip_checkpoint = {checkpoint!r}: the model gives no finite feature for any crop; "
            "use another checkpoint, or set run.precision to float32"
        )
    if lost := int((~good).sum()):
        log(f"warning: {lost} of {len(good)} views are skipped: the model gives no finite feature for them")
    return good
