"""Load SAM2 from a configuration and a checkpoint, as a video predictor."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from torch import nn

from egosplat.compute import Compute, choose_compute
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, find_checkpoint, sam2_config_file
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors

if TYPE_CHECKING:
    from sam2.modeling.sam2_base import SAM2Base

    from egosplat.models.video_predictor import VideoPredictor

# Overrides that ``sam2.build_sam`` applies to a configuration for prediction.
AS_PREDICTOR = {
    "_target_": "egosplat.models.video_predictor.VideoPredictor",
    "sam_mask_decoder_extra_args": {
        "dynamic_multimask_via_stability": True,
        "dynamic_multimask_stability_delta": 0.05,
        "dynamic_multimask_stability_thresh": 0.98,
    },
    "binarize_mask_from_pts_for_mem_enc": True,
    "fill_hole_area": 8,
}

# Errors that the readers raise for valid YAML that is no SAM2 configuration, or is nested too deeply.
_NO_DESCRIPTION = (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError)


@dataclass(frozen=True)
class Sam2:
    """SAM2 with its weights, to run within ``compute.inference()``; ``video_predictor.image_size`` is the side of the square to
    which every image is resized [px]."""

    video_predictor: "VideoPredictor"
    compute: Compute

    @contextmanager
    def at_side(self, side: int | None) -> Iterator[None]:
        """Resize images to another side [px] inside this context; None keeps the model's."""
        before = self.video_predictor.image_size
        set_image_size(self.video_predictor, side or before)
        try:
            yield
        finally:
            set_image_size(self.video_predictor, before)


def load_sam2(
    config: str, checkpoint: str, device: str, precision: str, image_size: int | None = None
) -> Sam2:
    """Build SAM2 and load a checkpoint into it, by keys of the configuration's section ``models``, without downloads.

    ``image_size`` is as in ``set_image_size``; None keeps the configuration's. UserError: a file or the device is missing, a
    file is damaged, or the files do not match.
    """
    compute = choose_compute(device, precision)
    file, path = sam2_config_file(config), find_checkpoint(SAM2, checkpoint)
    tensors = read_tensors(path)
    with NothingDrawn():
        predictor = build_predictor(file)
    load_weights(predictor, tensors, path, SAM2)
    if image_size is not None:
        set_image_size(predictor, image_size)
    return Sam2(predictor.to(compute.device).eval().requires_grad_(False), compute)


def set_image_size(model: "SAM2Base", side: int) -> None:
    """Set the side of the square that images are resized to, a multiple of 32 [px]; larger ones show smaller objects."""
    # SAM2's weights fit any side: its positional encodings are relative to it, or computed from the features' size.
    prompts = model.sam_prompt_encoder
    cells = side // model.backbone_stride
    model.image_size, model.sam_image_embedding_size = side, cells
    prompts.input_image_size, prompts.image_embedding_size = (side, side), (cells, cells)
    prompts.mask_input_size = (4 * cells, 4 * cells)


def build_predictor(file: Path) -> "VideoPredictor":
    """Build the video predictor that a YAML file describes, with random weights, on the CPU; UserError if it describes none.

    Hydra's global state is neither read nor changed. Interpolations can only refer to the file itself.
    """
    from hydra.errors import HydraException
    from hydra.utils import instantiate
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        tree = OmegaConf.load(file)
        OmegaConf.resolve(tree)
        _check_targets(OmegaConf.to_container(tree), file)
        return instantiate(OmegaConf.merge(tree.model, AS_PREDICTOR), _recursive_=True)
    except FileNotFoundError:
        raise
    except (yaml.YAMLError, OmegaConfBaseException, HydraException, *_NO_DESCRIPTION) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        advice = "See the configurations of the package sam2 for an example"
        raise UserError(f"{file}: describes no SAM2 ({reason}). {advice}") from None


def _check_targets(tree: Any, file: Path) -> None:
    """Raise UserError unless every ``_target_``, which Hydra would call, is a network of the package sam2."""
    targets = list(_targets(tree))
    for name in targets:
        if not _is_network(name):
            raise UserError(f"{file}: _target_ {str(name)[:200]!r} is no network of the package sam2")
    if not targets or not isinstance(tree, dict) or "model" not in tree:
        raise UserError(f"{file}: describes no SAM2: it has no key 'model' with a _target_")


def _is_network(name: object) -> bool:
    from hydra.utils import get_object

    if not isinstance(name, str) or not name.startswith("sam2."):
        return False
    try:
        # The prefix is not enough: sam2.build_sam.os.system is reachable by it.
        found = get_object(name)
    except (ImportError, AttributeError, ValueError):
        return False
    return isinstance(found, type) and issubclass(found, nn.Module) and found.__module__.startswith("sam2.")


def _targets(tree: Any) -> Iterator[Any]:
    if isinstance(tree, dict) and "_target_" in tree:
        yield tree["_target_"]
    for part in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        yield from _targets(part)
