"""Read a checkpoint's tensors without executing code in the file, and load them into a model."""

import pickle
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from egosplat.compute import all_finite
from egosplat.errors import UserError, is_out_of_memory
from egosplat.models.checkpoints import ModelSpec
from egosplat.pipeline.messages import shorten

_AGAIN = "Download or copy it again"

_PICKLED = (".pt", ".pth", ".bin")

# Keys under which training scripts, SAM2's and OpenCLIP's among them, store the tensors.
_WRAPPERS = ("model", "state_dict")

# Prefix that distributed training adds to every name.
_PARALLEL = "module."

# Errors that the unpickler raises for arbitrary bytes.
_RUBBISH = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, ImportError, LookupError, MemoryError),
    *(RuntimeError, TypeError, ValueError, struct.error),
)

# Messages of torch for a file that would call something other than a tensor constructor, TorchScript among them.
_CODE = re.compile(r"unsupported (global|class)|unrecognized function|torchscript", re.IGNORECASE)

# What constructors of networks draw nearly all of their weights with.
_DRAWS = (nn.init.kaiming_uniform_, nn.init.normal_, nn.init.uniform_, Tensor.uniform_)


class NothingDrawn(TorchFunctionMode):
    """Networks built inside this context hold anything where random weights would be drawn, until ``load_weights``.

    Drawing the weights of a large network takes longer than reading them.
    """

    def __torch_function__(
        self, function: Callable, types: Any, args: tuple = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Call a function of torch, unless it draws weights into a tensor."""
        named = kwargs or {}
        if function in _DRAWS:
            return args[0] if args else named["tensor"]
        return function(*args, **named)


def load_weights(module: nn.Module, tensors: Mapping[str, Tensor], path: Path, model: ModelSpec) -> None:
    """Set all tensors of a module, in its dtype and on its device, to those of the checkpoint at ``path``; it
    shares their memory (UserError: tensors are missing, unexpected or of another shape, or hold NaN, infinity
    or whole numbers)."""
    own = module.state_dict()
    if differences := _differences(own, tensors):
        key = f"models.{model.config_key}"
        raise UserError(
            f"{path}: has another architecture than {key}: {differences}.\nSet {key} to the architecture of this "
            f"checkpoint, or models.{model.checkpoint_key} to a checkpoint of that architecture"
        )
    for name, value in tensors.items():
        if own[name].is_floating_point() and not value.is_floating_point():
            wrong = f"tensor {name} holds {value.dtype}, not numbers with a fraction"
            raise UserError(f"{path}: {wrong}. {_AGAIN}")
        if not all_finite(value):
            raise UserError(f"{path}: tensor {name} holds NaN or infinity. {_AGAIN}")
    given = {name: value.to(own[name]).contiguous() for name, value in tensors.items()}
    # Copying would hold every weight twice.
    module.load_state_dict(given, assign=True)


def _differences(own: Mapping[str, Tensor], given: Mapping[str, Tensor]) -> str:
    """Missing, unexpected and reshaped tensors of a checkpoint, with an example of each; empty if none."""
    missing = [name for name in own if name not in given]
    unexpected = [name for name in given if name not in own]
    reshaped = [name for name in own if name in given and own[name].shape != given[name].shape]
    parts = []
    if missing:
        parts.append(f"{len(missing)} of {len(own)} tensors missing (as {missing[0]})")
    if unexpected:
        parts.append(f"{len(unexpected)} unexpected (as {unexpected[0]})")
    for name in reshaped[:1]:
        shapes = ["x".join(map(str, each[name].shape)) or "a number" for each in (given, own)]
        parts.append(f"{len(reshaped)} of another shape (as {name}, {' instead of '.join(shapes)})")
    return ", ".join(parts)


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Read the tensors of a checkpoint, a ``.safetensors``, ``.pt``, ``.pth`` or ``.bin`` file, by name, on the CPU, in their
    dtype.

    Raises:
        UserError: the file has another suffix, is damaged, or holds anything but tensors.
        MemoryError, RuntimeError: the memory does not suffice.
    """
    if path.suffix not in (".safetensors", *_PICKLED):
        raise UserError(f"{path}: a checkpoint's name ends in .safetensors, {', '.join(_PICKLED)}")
    content = _read_pickled(path) if path.suffix in _PICKLED else _read_safetensors(path)
    for wrapper in _WRAPPERS:
        if isinstance(content, Mapping) and isinstance(content.get(wrapper), Mapping):
            content = content[wrapper]
    tensors = content if isinstance(content, Mapping) else {}
    if others := [name for name, value in tensors.items() if not isinstance(value, Tensor)]:
        advice = f"Save the tensors alone, by name, or under the key {' or '.join(_WRAPPERS)}"
        raise UserError(f"{path}: holds {', '.join(map(shorten, others[:3]))} besides tensors. {advice}")
    if not tensors or not all(isinstance(name, str) for name in tensors):
        raise UserError(f"{path}: holds no named tensors and is no checkpoint; use another file")
    parallel = all(name.startswith(_PARALLEL) for name in tensors)
    return {name.removeprefix(_PARALLEL) if parallel else name: value for name, value in tensors.items()}


def _read_safetensors(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        # Copies: the file stays mapped, at addresses that are no multiple of what torch's own memory has.
        return {name: value.clone() for name, value in load_file(path).items()}
    except (SafetensorError, *_RUBBISH) as error:
        # safetensors checks the sizes in the header against the file: damage cannot cause a lack of memory.
        if is_out_of_memory(error):
            raise
        raise _damaged(path) from None


def _read_pickled(path: Path) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Detected pickle protocol|.*TorchScript")
            return torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        if error.filename is not None:
            raise
        raise _damaged(path) from None  # the reader of the zip archive seeked beyond its end
    except (pickle.UnpicklingError, *_RUBBISH) as error:
        # Random bytes can request any amount of memory; a complete archive requests only the size of its content.
        if is_out_of_memory(error) and zipfile.is_zipfile(path):
            raise
        if not _CODE.search(str(error)):
            raise _damaged(path) from None
        raise UserError(
            f"{path}: holds code or objects besides tensors, which egosplat does not load.\n"
            "Save only the tensors (torch.save(model.state_dict(), ...)), or convert it to safetensors"
        ) from None


def _damaged(path: Path) -> UserError:
    wrong = f"its {path.stat().st_size:,} bytes are damaged, truncated or another format"
    return UserError(f"{path}: is no complete checkpoint: {wrong}. {_AGAIN}")
