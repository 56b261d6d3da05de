"""SAM2's memory of one frame for a batch of objects: make it, select objects from it, update it."""

from typing import Any

import torch
from torch import Tensor

# ``maskmem_features`` (K, C, h, w) bfloat16, ``maskmem_pos_enc`` one (K, C, h, w), and ``obj_ptr`` (K, C), as
# SAM2 names them. Memories of older frames hold ``obj_ptr`` only.
Memory = dict[str, Any]


def make_memory(stored: Tensor, position: list[Tensor], pointers: Tensor) -> Memory:
    """The memory of a frame, from the outputs of SAM2's memory encoder."""
    return {
        "maskmem_features": stored.to(torch.bfloat16),  # as SAM2's predictor keeps them
        "maskmem_pos_enc": _expand(position, len(stored)),
        "obj_ptr": pointers,
    }


def select_objects(output: Memory, chosen: list[int]) -> Memory:
    """The memory of the chosen objects, by their places in the batch."""
    part: Memory = {"obj_ptr": output["obj_ptr"][chosen]}
    if "maskmem_features" in output:
        part["maskmem_features"] = output["maskmem_features"][chosen]
        part["maskmem_pos_enc"] = _expand(output["maskmem_pos_enc"], len(chosen))
    return part


def update_memory(last: Memory, chosen: list[int], new: Memory) -> Memory:
    """The memory of all objects: ``new`` for the chosen ones, that of the ``last`` frame for the others."""
    merged = dict(last)
    # Positional encodings are equal for all objects, and need no update.
    for name in {"maskmem_features", "obj_ptr"} & last.keys():
        merged[name] = last[name].clone()
        merged[name][chosen] = new[name].to(last[name].dtype)
    return merged


def to_device(output: Memory, device: torch.device) -> Memory:
    """Copy a memory to a device."""
    on_device = {name: value.to(device) for name, value in output.items() if isinstance(value, Tensor)}
    if "maskmem_pos_enc" in output:
        position = [each[:1].to(device) for each in output["maskmem_pos_enc"]]
        on_device["maskmem_pos_enc"] = _expand(position, len(on_device["obj_ptr"]))
    return on_device


def drop_features(output: Memory) -> None:
    """Remove the mask memory in place; the object pointers stay."""
    output.pop("maskmem_features", None)
    output.pop("maskmem_pos_enc", None)


def _expand(position: list[Tensor], count: int) -> list[Tensor]:
    # Positional encodings are equal for all objects: a view of one costs no memory.
    return [each[:1].expand(count, -1, -1, -1) for each in position]
