"""Descriptions of models: what calls something else, needs the network, or describes no model."""

import json
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from bad_input_bench.cases import Case, Sandbox
from bad_input_bench.models import SMUGGLED, load
from bad_input_bench.mutations import JSON_RUBBISH, RUBBISH, Break, fill
from egosplat.models.checkpoints import CLIP, SAM2
from egosplat.models.configs import CLIP_CONFIG, CLIP_VOCABULARY, SMALL_CLIP, SMALL_SAM2


def cases(_: random.Random) -> Iterator[Case]:
    """All of this family."""
    yield from _sam2_descriptions()
    yield from _clip_descriptions()


def _sam2_descriptions() -> Iterator[Case]:
    ways = {what: change for what, change in RUBBISH.items() if what not in ("half of it", "all but its end")}
    texts = {
        "a number": "3",
        "a list": "[1]",
        "nested without end": "[" * 50_000,
        "no target": "model: {a: 1}",
        "a model that is a number": "model: 3",
        "a target that is a number": "model: {_target_: 3}",
        "a target that there is not": "model: {_target_: sam2.nothing.Here}",
        "a command of os": f"model: {{_target_: os.system, command: {SMUGGLED}}}",
        "a command by way of sam2": f"model: {{_target_: sam2.build_sam.os.system, command: {SMUGGLED}}}",
        "a function of sam2": "model: {_target_: sam2.build_sam.build_sam2_hf, model_id: a/b}",
        "a command deep down": (
            "model: {_target_: sam2.modeling.sam2_base.SAM2Base, image_encoder: "
            f"[{{_target_: sam2.build_sam.os.system, command: {SMUGGLED}}}]}}"
        ),
        "an object of Python": f"model: !!python/object/apply:os.system ['{SMUGGLED}']",
        "an interpolation of nothing": "model: {_target_: '${nothing}'}",
        "a resolver that there is not": "model: {_target_: '${no.such:1}'}",
        "settings that there are not": "model: {_target_: sam2.modeling.sam2_base.SAM2Base, legs: 4}",
    }
    ways |= {what: fill(text) for what, text in texts.items()}
    for what, change in ways.items():
        yield _sam2(what, change)
    for what, key in {"a size in words": "image_size", "memories in words": "num_maskmem"}.items():
        yield _sam2(what, lambda path, key=key: _set_sam2(path, key, "many"))


def _set_sam2(path: Path, key: str, value: Any) -> None:
    tree = yaml.safe_load(path.read_text())
    tree["model"][key] = value
    path.write_text(yaml.safe_dump(tree))


def _sam2(what: str, change: Break) -> Case:
    def command(box: Sandbox) -> Callable[[], object]:
        path = box.folder / "mine.yaml"
        shutil.copy(SMALL_SAM2, path)
        change(path)
        return load(SAM2, str(path), "small")

    return Case("models: descriptions", f"SAM2: {what}", command, ("mine.yaml",), scene=False)


def _clip_descriptions() -> Iterator[Case]:
    for what, change in (RUBBISH | JSON_RUBBISH).items():
        yield _clip(what, CLIP_CONFIG, change)
    for what, change in RUBBISH.items():
        yield _clip(f"vocabulary: {what}", CLIP_VOCABULARY, change)
    odd: dict[str, tuple[tuple[str, ...], Any]] = {
        "text settings that are a list": (("model_cfg", "text_cfg"), []),
        "picture settings that are a word": (("model_cfg", "vision_cfg"), "large"),
        "a width in words": (("model_cfg", "text_cfg", "width"), "wide"),
        "a width of 0": (("model_cfg", "text_cfg", "width"), 0),
        "no heads": (("model_cfg", "text_cfg", "heads"), 0),
        "layers in words": (("model_cfg", "vision_cfg", "layers"), "many"),
        "a picture's size in words": (("model_cfg", "vision_cfg", "image_size"), "big"),
        "a dimension that is null": (("model_cfg", "embed_dim"), None),
        "a setting that there is not": (("model_cfg", "legs"), 4),
        "a context in words": (("model_cfg", "text_cfg", "context_length"), "long"),
        "a tokenizer that is a number": (("model_cfg", "text_cfg", "tokenizer_kwargs"), 3),
        "a text model from the network": (("model_cfg", "text_cfg", "hf_model_name"), "a/b"),
        "a vision model from the network": (("model_cfg", "vision_cfg", "timm_model_name"), "hf-hub:a/b"),
        "a vision model that there is not": (("model_cfg", "vision_cfg", "timm_model_name"), "no_such_model"),
        "a mean that is a number": (("preprocess_cfg", "mean"), 3),
        "a mean of words": (("preprocess_cfg", "mean"), ["a", "b", "c"]),
        "preprocessing that is a list": (("preprocess_cfg",), [1]),
        "an interpolation that there is not": (("preprocess_cfg", "interpolation"), "magic"),
    }
    for what, (place, value) in odd.items():
        yield _clip(what, CLIP_CONFIG, lambda path, place=place, value=value: _set(path, place, value))
    for name in ("no-such-model", "hf-hub:a/b", "../..", "ViT-B-16;touch", "x" * 300):
        yield Case(
            "models: descriptions",
            f"OpenCLIP called {name[:20]!r}",
            lambda _, name=name: load(CLIP, name, "small"),
            (name[:20],),
            scene=False,
        )


def _set(path: Path, place: tuple[str, ...], value: Any) -> None:
    tree = part = json.loads(path.read_text())
    for name in place[:-1]:
        part = part.setdefault(name, {})
    part[place[-1]] = value
    path.write_text(json.dumps(tree))


def _clip(what: str, file: str, change: Break) -> Case:
    def command(box: Sandbox) -> Callable[[], object]:
        folder = box.folder / "my_model"
        shutil.copytree(SMALL_CLIP, folder, ignore=shutil.ignore_patterns("*.safetensors"))
        change(folder / file)
        return load(CLIP, str(folder), "small")

    named = ("my_model", CLIP_CONFIG, "models.clip")
    return Case("models: descriptions", f"OpenCLIP: {what}", command, named, scene=False)
