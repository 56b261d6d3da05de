"""Load the OpenCLIP model that made the features, to encode queries."""

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import OpenClip, load_open_clip


def load_clip_of(features: Artifact, model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Load OpenCLIP and check that it is the model that made the features.

    Args:
        model, checkpoint, device, precision: see ``load_open_clip``.

    Raises:
        UserError: the files hold another model, or cannot be loaded.
    """
    # Text and image features of different models are not comparable.
    made_with = features.facts["clip"]
    found = model_hash(CLIP, {CLIP.config_key: model, CLIP.checkpoint_key: checkpoint})
    if found != made_with["hash"]:
        raise UserError(
            f"{features.path}: was made with another OpenCLIP ({made_with['model']}, {made_with['checkpoint']}, "
            f"hash {made_with['hash']}) than {model}, {checkpoint} (hash {found}).\n"
            f"Restore that checkpoint, or rebuild the features: snakemake --cores 2 {features.path}"
        )
    return load_open_clip(model, checkpoint, device, precision)
