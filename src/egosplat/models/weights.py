"""Reading a checkpoint's tensors, without executing what the file holds, and filling a model with them."""

import pickle
import struct
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from egosplat.errors import UserError, is_out_of_memory
from egosplat.models.checkpoints import ModelSpec

PICKLED = (".pt", ".pth", ".bin")
WRAPPERS = ("model", "state_dict")
"""Keys below which training scripts keep the tensors, SAM2's and OpenCLIP's among them."""

PARALLEL = "module."
"""What distributed training puts before every name."""

RUBBISH = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)
"""What arbitrary bytes make the unpickler raise."""


CODE = ("Unsupported global", "Unsupported class", "unrecognized function")
"""What the unpickler says where a file asks it to call something that makes no tensor."""


def read_tensors(path: Path) -> dict[str, Tensor]:
    """The tensors of a checkpoint by name, on the CPU, in the number type in which they are stored.

    A ``.safetensors`` file, or a ``.pt``, ``.pth`` or ``.bin`` file of torch, of which only tensors are read.

    Raises:
        UserError: the file is of another kind, damaged, or holds anything but tensors.
        MemoryError, RuntimeError: the system refuses the memory for it.
    """
    if path.suffix == ".safetensors":
        content = _read_safetensors(path)
    elif path.suffix in PICKLED:
        content = _read_pickled(path)
    else:
        raise UserError(f"{path}: a checkpoint's name ends in .safetensors, {', '.join(PICKLED)}")
    return _state(content, path)


def load_weights(module: nn.Module, tensors: Mapping[str, Tensor], path: Path, model: ModelSpec) -> None:
    """Copy a checkpoint's tensors into a module, in the module's own number type.

    Args:
        module: what is filled, all of it.
        tensors: of the checkpoint, see ``read_tensors``.
        path: of the checkpoint, for messages.
        model: which model it is of, for messages.

    Raises:
        UserError: tensors are missing, unexpected or of another shape: it is of another architecture.
    """
    if differences := _differences(module.state_dict(), tensors):
        raise UserError(
            f"{path}: is of another architecture than models.{model.config_key} names: {differences}.\n"
            f"Set models.{model.config_key} to the architecture of this checkpoint, or models."
            f"{model.checkpoint_key} to a checkpoint of that architecture"
        )
    module.load_state_dict(tensors)


def _read_safetensors(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        return load_file(path)
    except (SafetensorError, *RUBBISH) as error:
        if is_out_of_memory(error):  # never by what the file says: its sizes are held against its own
            raise
        raise _damaged(path) from None


def _read_pickled(path: Path) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Detected pickle protocol")
            return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        if not any(words in str(error) for words in CODE):
            raise _damaged(path) from None
        raise UserError(
            f"{path}: holds code or objects beside tensors, which egosplat does not load.\n"
            "Save the tensors alone (torch.save(model.state_dict(), ...)), or convert it to safetensors"
        ) from None
    except OSError as error:
        if error.filename is not None:
            raise
        raise _damaged(path) from None  # the archive's reader went beyond its end
    except RUBBISH as error:
        # Rubbish may ask for any memory, an archive that is whole to its end only for what it holds.
        if is_out_of_memory(error) and zipfile.is_zipfile(path):
            raise
        raise _damaged(path) from None


def _damaged(path: Path) -> UserError:
    size = path.stat().st_size
    return UserError(
        f"{path}: is no whole checkpoint but {size:,} bytes that are damaged, cut short or something else. "
        "Download or copy it again"
    )


def _state(content: Any, path: Path) -> dict[str, Tensor]:
    for wrapper in WRAPPERS:
        if isinstance(content, Mapping) and isinstance(content.get(wrapper), Mapping):
            content = content[wrapper]
    tensors = content if isinstance(content, Mapping) else {}
    named = all(isinstance(name, str) and isinstance(value, Tensor) for name, value in tensors.items())
    if not tensors or not named:
        raise UserError(f"{path}: holds no tensors by name, as a checkpoint does; take another file")
    parallel = all(name.startswith(PARALLEL) for name in tensors)
    return {name.removeprefix(PARALLEL) if parallel else name: value for name, value in tensors.items()}


def _differences(own: Mapping[str, Tensor], given: Mapping[str, Tensor]) -> str:
    """What a checkpoint lacks or has too much, with an example of each; empty if nothing."""
    missing = [name for name in own if name not in given]
    unexpected = [name for name in given if name not in own]
    reshaped = [name for name in own if name in given and own[name].shape != given[name].shape]
    parts = []
    if missing:
        parts.append(f"{len(missing)} of {len(own)} tensors missing (as {missing[0]})")
    if unexpected:
        parts.append(f"{len(unexpected)} unexpected (as {unexpected[0]})")
    if reshaped:
        name = reshaped[0]
        shapes = f"{_shape(given[name])} instead of {_shape(own[name])}"
        parts.append(f"{len(reshaped)} of another shape (as {name}, {shapes})")
    return ", ".join(parts)


def _shape(tensor: Tensor) -> str:
    return "x".join(map(str, tensor.shape)) or "a number"
