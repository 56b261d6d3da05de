"""The OpenCLIP that reads queries: the one that the features were made with."""

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import OpenClip, load_open_clip


def load_clip_of(features: Artifact, model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Load the model that the features come from; any other sees nothing in them.

    Args:
        features: the features artifact.
        model, checkpoint, device, precision: see ``load_open_clip``.

    Raises:
        UserError: the files hold another model, or cannot be loaded.
    """
    made_with = features.facts["clip"]
    found = model_hash(CLIP, {CLIP.config_key: model, CLIP.checkpoint_key: checkpoint})
    if found != made_with["hash"]:
        raise UserError(
            f"{features.path}: was made with another OpenCLIP ({made_with['model']}, {made_with['checkpoint']}, "
            f"hash {made_with['hash']}) than {model}, {checkpoint} holds (hash {found}).\n"
            f"Put that one back, or make the features anew: snakemake --cores 2 {features.path}"
        )
    return load_open_clip(model, checkpoint, device, precision)
