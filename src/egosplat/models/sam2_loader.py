"""SAM2 from a configuration and a checkpoint, as predictor for images and for videos."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from torch import nn

from egosplat.compute import Compute, choose_compute
from egosplat.errors import UserError
from egosplat.models.checkpoints import SAM2, find_checkpoint
from egosplat.models.configs import sam2_config_file
from egosplat.models.weights import load_weights, read_tensors

if TYPE_CHECKING:
    from sam2.modeling.sam2_base import SAM2Base

    from egosplat.models.video_predictor import VideoPredictor

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
"""What SAM2 sets over a configuration to predict with it (``sam2.build_sam``)."""

_NO_DESCRIPTION = (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError)
"""What the readers raise on a file that is YAML, but of something else, or nested without end."""


@dataclass(frozen=True)
class Sam2:
    """SAM2 with its weights.

    Attributes:
        video_predictor: follows objects through a video; its ``image_size`` is the side of the square to which
            every image is resized [px].
        compute: where it runs; all predictions are made within ``compute.inference()``.
    """

    video_predictor: "VideoPredictor"
    compute: Compute


def load_sam2(
    config: str, checkpoint: str, device: str, precision: str, image_size: int | None = None
) -> Sam2:
    """Build SAM2 and fill it with a checkpoint; nothing is downloaded.

    Args:
        config, checkpoint, device, precision: the keys ``sam2_config``, ``sam2_checkpoint``, ``device`` and
            ``precision`` of the configuration's section ``models``.
        image_size: see ``set_image_size``; None is the configuration's own.

    Raises:
        UserError: a file is missing, damaged, or does not fit the other; the device is not there.
    """
    compute = choose_compute(device, precision)
    file, path = sam2_config_file(config), find_checkpoint(SAM2, checkpoint)
    tensors = read_tensors(path)
    predictor = build_predictor(file)
    load_weights(predictor, tensors, path, SAM2)
    if image_size is not None:
        set_image_size(predictor, image_size)
    return Sam2(predictor.to(compute.device).eval().requires_grad_(False), compute)


def set_image_size(model: "SAM2Base", side: int) -> None:
    """Let a model work on images of another side: SAM2's weights fit any, and larger ones show finer things.

    Positions are told as shares of the image's side, or computed for the features that come; nothing else knows
    of it.

    Args:
        side: of the square image, a multiple of 32 [px].
    """
    prompts = model.sam_prompt_encoder
    cells = side // model.backbone_stride
    model.image_size, model.sam_image_embedding_size = side, cells
    prompts.input_image_size, prompts.image_embedding_size = (side, side), (cells, cells)
    prompts.mask_input_size = (4 * cells, 4 * cells)


def build_predictor(file: Path) -> "VideoPredictor":
    """The video predictor that a YAML file describes, with random weights, on the CPU.

    Hydra's global state is neither read nor changed: interpolations may refer to the file itself alone.

    Raises:
        UserError: the file cannot be read, or describes no SAM2.
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
        raise UserError(f"{file}: describes no SAM2 ({reason}). Take one of sam2's own as example") from None


def _check_targets(tree: Any, file: Path) -> None:
    """A configuration names what is called: modules of SAM2's networks alone are.

    A name below ``sam2.`` is not enough: its modules import others, as ``sam2.build_sam.os.system``.
    """
    targets = list(_targets(tree))
    if foreign := [name for name in targets if not _is_network(name)]:
        raise UserError(f"{file}: _target_ {str(foreign[0])[:200]!r} is no network of the package sam2")
    if not targets or not isinstance(tree, dict) or "model" not in tree:
        raise UserError(f"{file}: describes no SAM2: it has no key 'model' with a _target_")


def _is_network(name: object) -> bool:
    from hydra.utils import get_object

    if not isinstance(name, str) or not name.startswith("sam2."):
        return False
    try:
        found = get_object(name)
    except (ImportError, AttributeError, ValueError):
        return False
    return isinstance(found, type) and issubclass(found, nn.Module) and found.__module__.startswith("sam2.")


def _targets(tree: Any) -> Iterator[Any]:
    if isinstance(tree, dict):
        if "_target_" in tree:
            yield tree["_target_"]
        tree = list(tree.values())
    if isinstance(tree, list):
        for part in tree:
            yield from _targets(part)
