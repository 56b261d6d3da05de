"""Load OpenCLIP from a configuration and a checkpoint, with its tokenizer and preprocessing."""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import nn

from egosplat.artifacts.reader import Artifact
from egosplat.compute import choose_compute
from egosplat.errors import UserError
from egosplat.files import read_json, read_user_text
from egosplat.models.checkpoints import CLIP, find_checkpoint, model_hash
from egosplat.models.clip import OpenClip, Preprocessing
from egosplat.models.configs import CLIP_CONFIG, CLIP_VOCABULARY, CLIP_WORDS, PHOTOS, clip_folder
from egosplat.models.weights import NothingDrawn, load_weights, read_tensors
from egosplat.models.without_compiler import without_compiler
from egosplat.pipeline.home import make_command

if TYPE_CHECKING:
    from open_clip import SimpleTokenizer

# Errors that OpenCLIP raises for invalid settings.
_NO_MODEL = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
)

# Keys of a text model that would be downloaded from the Hugging Face hub.
HUB_KEYS = ("hf_model_name", "hf_tokenizer_name")

# What crops can be resized by.
_INTERPOLATIONS = ("bicubic", "bilinear")


def load_open_clip(model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Build an OpenCLIP model and load a checkpoint into it, without downloads.

    Args:
        model, checkpoint, device, precision: the keys ``clip_model``, ``clip_checkpoint``, ``device`` and
            ``precision`` of the configuration's section ``models``.

    Raises:
        UserError: a file is missing or damaged, or the files do not match; a part of the model would have to be
            downloaded; the device is missing.
    """
    if PHOTOS in (model, checkpoint):
        return _load_photo_words(model, checkpoint, device, precision)
    compute = choose_compute(device, precision)
    folder, path = clip_folder(model), find_checkpoint(CLIP, checkpoint)
    description = read_description(model, folder)
    tensors = read_tensors(path)
    with NothingDrawn():
        module = build_model(model, description["model_cfg"])
    load_weights(module, tensors, path, CLIP)
    return OpenClip(
        module.to(compute.device).eval().requires_grad_(False),
        _preprocessing(module, description.get("preprocess_cfg", {})),
        _tokenizer(model, folder, description["model_cfg"]["text_cfg"]),
        compute,
        _read_words(folder),
    )


def _load_photo_words(model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Load the model of ``models.set: photos``, which has OpenCLIP's interface."""
    from egosplat.models.photo_words import load_photo_words

    if model != checkpoint:
        raise UserError(
            f"models.clip_model = {model}, models.clip_checkpoint = {checkpoint}: both are photos, or neither is. "
            "Set models.set to photos, which sets both"
        )
    return load_photo_words(device, precision)


def _read_words(folder: Path | None) -> frozenset[str] | None:
    if folder is None or not (path := folder / CLIP_WORDS).is_file():
        return None
    return frozenset(read_user_text(path).split())


def read_description(model: str, folder: Path | None) -> dict[str, Any]:
    """Read ``model_cfg``, and ``preprocess_cfg`` if present, from a folder, or from open_clip if folder is None.

    Raises:
        UserError: the folder's ``open_clip_config.json`` is damaged, or the model needs the Hugging Face hub.
    """
    if folder is None:
        with without_compiler():
            from open_clip import get_model_config

        description: dict[str, Any] = {"model_cfg": get_model_config(model)}
    else:
        description = _read_json(folder / CLIP_CONFIG)
    vision, text = (description["model_cfg"][part] for part in ("vision_cfg", "text_cfg"))
    if any(text.get(key) for key in HUB_KEYS) or (folder is None and "siglip" in model.lower()):
        raise UserError(
            f"models.clip_model = {model!r}: its text model or tokenizer comes from the Hugging Face hub, and "
            "stages download nothing. Use a model with OpenCLIP's own tokenizer, such as ViT-B-16"
        )
    if vision.get("timm_model_pretrained") or ":" in str(vision.get("timm_model_name") or ""):
        raise UserError(
            f"models.clip_model = {model!r}: its vision model needs a download, and "
            "stages download nothing. Use the name of a timm model with timm_model_pretrained: false"
        )
    return description


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
    except _NO_MODEL as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise UserError(
            f"models.clip_model = {model!r}: model_cfg describes no OpenCLIP model ({reason})"
        ) from None


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = read_json(path)
    except ValueError as error:
        raise UserError(f"{path}: cannot be read as JSON ({error})") from None
    parts = content.get("model_cfg") if isinstance(content, dict) else None
    parts = parts if isinstance(parts, dict) else {}
    described = all(isinstance(parts.get(name), dict) for name in ("vision_cfg", "text_cfg"))
    if "embed_dim" not in parts or not described:
        raise UserError(f"{path}: lacks model_cfg with embed_dim, vision_cfg and text_cfg")
    return content


def _preprocessing(module: nn.Module, given: dict[str, Any]) -> Preprocessing:
    from open_clip.transform import PreprocessCfg, merge_preprocess_dict

    size = module.visual.image_size
    try:
        values = merge_preprocess_dict(PreprocessCfg(), given)
        mean, std = (_three(values[name]) for name in ("mean", "std"))
    except _NO_MODEL as error:
        raise UserError(f"{CLIP_CONFIG}: preprocess_cfg is not in OpenCLIP's format ({error})") from None
    if (kind := values["interpolation"]) not in _INTERPOLATIONS:
        raise UserError(
            f"{CLIP_CONFIG}: preprocess_cfg.interpolation = {kind!r}; use one of {', '.join(_INTERPOLATIONS)}"
        )
    return Preprocessing((size, size) if isinstance(size, int) else tuple(size), mean, std, kind)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    red, green, blue = map(float, values)
    return red, green, blue


def _tokenizer(model: str, folder: Path | None, text: dict[str, Any]) -> "SimpleTokenizer":
    from open_clip import SimpleTokenizer
    from open_clip.tokenizer import DEFAULT_CONTEXT_LENGTH

    arguments = text.get("tokenizer_kwargs", {})
    arguments = dict(arguments) if isinstance(arguments, dict) else {"tokenizer_kwargs": arguments}
    if folder is not None and (vocabulary := folder / CLIP_VOCABULARY).is_file():
        arguments["bpe_path"] = str(vocabulary)
    try:
        tokenizer = SimpleTokenizer(
            context_length=text.get("context_length", DEFAULT_CONTEXT_LENGTH), **arguments
        )
    except (EOFError, OSError, zlib.error, *_NO_MODEL) as error:
        raise UserError(
            f"{arguments.get('bpe_path', model)}: is no byte-pair vocabulary ({error}); copy it again"
        ) from None
    if tokenizer.vocab_size != text.get("vocab_size", tokenizer.vocab_size):
        raise UserError(
            f"models.clip_model = {model!r}: the tokenizer has {tokenizer.vocab_size:,} tokens, the text model "
            f"{text['vocab_size']:,}. Put the {CLIP_VOCABULARY} of its training next to {CLIP_CONFIG}"
        )
    return tokenizer


def load_clip_of(features: Artifact, model: str, checkpoint: str, device: str, precision: str) -> OpenClip:
    """Load OpenCLIP and check that it is the model that made the features.

    Args:
        features: features or tiles.
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
            f"Restore that checkpoint, or rebuild the features: {make_command(features.path)}"
        )
    return load_open_clip(model, checkpoint, device, precision)
