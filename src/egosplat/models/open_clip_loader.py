"""Load OpenCLIP from a configuration and a checkpoint, with its tokenizer and preprocessing."""

import zlib
from pathlib import Path
from typing import Any

from torch import nn

from egosplat.artifacts.reader import Artifact
from egosplat.compute import choose_compute
from egosplat.errors import UserError
from egosplat.files import read_user_text, read_users_json
from egosplat.models.checkpoints import (
    CLIP,
    CLIP_CONFIG,
    CLIP_VOCABULARY,
    CLIP_WORDS,
    PHOTOS,
    clip_folder,
    find_checkpoint,
    model_hash,
)
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors
from egosplat.models.without_compiler import without_compiler
from egosplat.pipeline.home import make_command

# Errors that OpenCLIP raises for invalid settings.
_INVALID = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)

# What crops can be resized by.
_INTERPOLATIONS = ("bicubic", "bilinear")


def load_open_clip(model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Build an OpenCLIP model and load a checkpoint into it, by keys of the configuration's section
    ``models``, without downloads (UserError: a file or the device is missing, a file is damaged, files do not
    match, or a part would have to be downloaded)."""
    if model == checkpoint == PHOTOS:
        from egosplat.models.photo_words import load_photo_words

        return load_photo_words(device, precision)
    if PHOTOS in (model, checkpoint):
        raise UserError(
            f"models.clip_model = {model}, models.clip_checkpoint = {checkpoint}: both are photos, or neither is. "
            "Set models.set to photos, which sets both"
        )
    compute = choose_compute(device, precision)
    folder, path = clip_folder(model), find_checkpoint(CLIP, checkpoint)
    description = read_description(model, folder)
    tensors = read_tensors(path)
    with NothingDrawn():
        module = build_model(model, description["model_cfg"])
    load_weights(module, tensors, path, CLIP)
    words = None if folder is None else folder / CLIP_WORDS
    return OpenClip(
        module.to(compute.device).eval().requires_grad_(False),
        _preprocessing(module, description.get("preprocess_cfg", {})),
        _tokenizer(model, folder, description["model_cfg"]["text_cfg"]),
        compute,
        frozenset(read_user_text(words).split()) if words and words.is_file() else None,
    )


def load_clip_of(features: Artifact, model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Load OpenCLIP as ``load_open_clip`` does; UserError if it is not the model that made the features or tiles."""
    # Text and image features of different models are not comparable.
    made_with = features.facts["clip"]
    found = model_hash(CLIP, {CLIP.config_key: model, CLIP.checkpoint_key: checkpoint})
    if found != made_with["hash"]:
        raise UserError(
            f"{features.path}: was made with another OpenCLIP ({made_with['model']}, {made_with['checkpoint']}, "
            f"hash {made_with['hash']}) than {model}, {checkpoint} (hash {found}).\n"
            f"Restore that checkpoint, or rebuild the features: {make_command(features.path)}"
        )
    return load_open_clip(model, checkpoint, device, precision)


def read_description(model: str, folder: Path | None) -> dict[str, Any]:
    """Read ``model_cfg``, and ``preprocess_cfg`` if present, from a folder, or from open_clip without one (UserError: the
    folder's ``open_clip_config.json`` is damaged, or the model needs the Hugging Face hub)."""
    if folder is None:
        with without_compiler():
            from open_clip import get_model_config

        description: dict[str, Any] = {"model_cfg": get_model_config(model)}
    else:
        description = _read_config(folder / CLIP_CONFIG)
    vision, text = (description["model_cfg"][name] for name in ("vision_cfg", "text_cfg"))
    from_hub = text.get("hf_model_name") or text.get("hf_tokenizer_name")
    if from_hub or (folder is None and "siglip" in model.lower()):
        needed = "its text model or tokenizer comes from the Hugging Face hub"
        advice = "Use a model with OpenCLIP's own tokenizer, such as ViT-B-16"
    elif vision.get("timm_model_pretrained") or ":" in str(vision.get("timm_model_name") or ""):
        needed = "its vision model needs a download"
        advice = "Use the name of a timm model with timm_model_pretrained: false"
    else:
        return description
    raise UserError(f"models.clip_model = {model!r}: {needed}, and stages download nothing. {advice}")


def _read_config(path: Path) -> dict[str, Any]:
    match content := read_users_json(path):
        case {"model_cfg": {"embed_dim": _, "vision_cfg": dict(), "text_cfg": dict()}}:
            return content
    raise UserError(f"{path}: lacks model_cfg with embed_dim, vision_cfg and text_cfg")


def build_model(model: str, description: dict[str, Any]) -> nn.Module:
    """Build the module that ``model_cfg`` describes, with random weights, on the CPU; UserError if it is invalid."""
    with without_compiler():
        import open_clip

    # As open_clip.create_model chooses the class.
    arguments = {key: value for key, value in description.items() if key != "custom_text"}
    kind = open_clip.CLIP
    if description.get("custom_text"):
        kind = open_clip.CoCa if "multimodal_cfg" in description else open_clip.CustomTextCLIP
    try:
        return kind(**arguments)
    except _INVALID as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        wrong = f"model_cfg describes no OpenCLIP model ({reason})"
        raise UserError(f"models.clip_model = {model!r}: {wrong}") from None


def _preprocessing(module: nn.Module, given: dict[str, Any]) -> Preprocessing:
    from open_clip.transform import PreprocessCfg, merge_preprocess_dict

    visual: Any = module.visual
    try:
        values = merge_preprocess_dict(PreprocessCfg(), given)
        (red, green, blue), (red_std, green_std, blue_std) = (
            map(float, values[key]) for key in ("mean", "std")
        )
    except _INVALID as error:
        raise UserError(f"{CLIP_CONFIG}: preprocess_cfg is not in OpenCLIP's format ({error})") from None
    if (kind := values["interpolation"]) not in _INTERPOLATIONS:
        raise UserError(
            f"{CLIP_CONFIG}: preprocess_cfg.interpolation = {kind!r}; use one of {', '.join(_INTERPOLATIONS)}"
        )
    size = visual.image_size
    height, width = (size, size) if isinstance(size, int) else size
    return Preprocessing((height, width), (red, green, blue), (red_std, green_std, blue_std), kind)


def _tokenizer(model: str, folder: Path | None, text: dict[str, Any]) -> Any:
    from open_clip import SimpleTokenizer
    from open_clip.tokenizer import DEFAULT_CONTEXT_LENGTH

    arguments = text.get("tokenizer_kwargs", {})
    arguments = dict(arguments) if isinstance(arguments, dict) else {"tokenizer_kwargs": arguments}
    if folder is not None and (vocabulary := folder / CLIP_VOCABULARY).is_file():
        arguments["bpe_path"] = str(vocabulary)
    arguments["context_length"] = text.get("context_length", DEFAULT_CONTEXT_LENGTH)
    try:
        tokenizer = SimpleTokenizer(**arguments)
    except (EOFError, OSError, zlib.error, *_INVALID) as error:
        what = arguments.get("bpe_path", model)
        raise UserError(f"{what}: is no byte-pair vocabulary ({error}); copy it again") from None
    if tokenizer.vocab_size != text.get("vocab_size", tokenizer.vocab_size):
        raise UserError(
            f"models.clip_model = {model!r}: the tokenizer has {tokenizer.vocab_size:,} tokens, the text model "
            f"{text['vocab_size']:,}. Put the {CLIP_VOCABULARY} of its training next to {CLIP_CONFIG}"
        )
    return tokenizer
