"""Checkpoints of models: code in them, half of them, and other architectures."""

import os
import pickle
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file

from bad_input_bench.cases import Case, Sandbox
from bad_input_bench.mutations import RUBBISH, Break, cut, fill
from egosplat.models.checkpoints import CLIP, SAM2, Model

SMUGGLED = "touch ../outside/canary"


class Bomb:
    """Runs a command where it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (SMUGGLED,)


def cases(rng: random.Random) -> Iterator[Case]:
    """All of this family."""
    for model in (SAM2, CLIP):
        for suffix in (".safetensors", ".pt", ".bin"):
            for what, change in RUBBISH.items():
                yield _checkpoint(model, suffix, what, change)
        for what, content in _contents(rng).items():
            yield _checkpoint(model, ".pt", what, lambda path, content=content: torch.save(content, path))
        yield _checkpoint(model, ".pt", "a pickle with a command", fill(pickle.dumps(Bomb())))
        yield _checkpoint(model, ".pth", "a legacy file with a command", _legacy)
        yield _checkpoint(model, ".txt", "a name of another kind", lambda _: None)
        for share in sorted(round(rng.uniform(0.01, 0.99), 3) for _ in range(4)):
            yield _checkpoint(model, ".safetensors", f"{share} of it", cut(share))
        yield _checkpoint(
            model, ".safetensors", "a header of 2^60 bytes", fill((2**60).to_bytes(8, "little"))
        )
        yield _checkpoint(model, ".safetensors", "a tensor less", _without_one)
        yield _checkpoint(
            model, ".safetensors", "the other model's", lambda path, model=model: _other(model, path)
        )


def _contents(rng: random.Random) -> dict[str, Any]:
    return {
        "a tensor with a command": {"model": {"a": torch.ones(3), "b": Bomb()}},
        "a command alone": Bomb(),
        "a list": [torch.ones(2)],
        "a tensor": torch.ones(2),
        "nothing": {},
        "names that are numbers": {1: torch.ones(rng.randrange(1, 5))},
        "no tensors": {"a": 1},
        "tensors of something else": {"a": torch.ones(2)},
        "a whole module": torch.nn.Linear(2, 2),
    }


def _legacy(path: Path) -> None:
    torch.save({"a": Bomb()}, path, _use_new_zipfile_serialization=False)


def _without_one(path: Path) -> None:
    tensors = load_file(path)
    tensors.pop(min(tensors))
    save_file(tensors, path)


def _other(model: Model, path: Path) -> None:
    shutil.copy((CLIP if model is SAM2 else SAM2).small, path)


def load(model: Model, config: str, checkpoint: str) -> Callable[[], object]:
    """As stages load it."""
    from egosplat.models.open_clip_loader import load_open_clip
    from egosplat.models.sam2_loader import load_sam2

    build = load_sam2 if model is SAM2 else load_open_clip
    return lambda: build(config, checkpoint, "cpu", "float32")


def _checkpoint(model: Model, suffix: str, what: str, change: Break) -> Case:
    def command(box: Sandbox) -> Callable[[], object]:
        path = box.folder / f"weights{suffix}"
        shutil.copy(model.small, path)
        change(path)
        return load(model, "small", str(path))

    name = f"{model.name}, {suffix}: {what}"
    return Case("models: checkpoints", name, command, (f"weights{suffix}",), scene=False)
