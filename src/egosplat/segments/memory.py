"""What SAM2's memory keeps of one frame for a batch of objects: all of it, or that of some."""

from typing import Any

import torch
from torch import Tensor

Memory = dict[str, Any]
"""``maskmem_features`` (K, C, h, w) bfloat16, ``maskmem_pos_enc`` one (K, C, h, w), and ``obj_ptr`` (K, C), as SAM2
names them; of older frames the pointers alone."""


def make_memory(stored: Tensor, position: list[Tensor], pointers: Tensor) -> Memory:
    """Memory of a frame: features in half the bytes, as SAM2 keeps them; positions are the same for all objects."""
    return {
        "maskmem_features": stored.to(torch.bfloat16),
        "maskmem_pos_enc": _alike(position, len(stored)),
        "obj_ptr": pointers,
    }


def select_objects(output: Memory, chosen: list[int]) -> Memory:
    """The memory of the chosen objects alone."""
    part: Memory = {"obj_ptr": output["obj_ptr"][chosen]}
    if "maskmem_features" in output:
        part["maskmem_features"] = output["maskmem_features"][chosen]
        part["maskmem_pos_enc"] = _alike(output["maskmem_pos_enc"], len(chosen))
    return part


def update_memory(last: Memory, chosen: list[int], new: Memory) -> Memory:
    """The memory of all objects: ``new`` of the chosen ones, of the others that of the ``last`` frame."""
    merged = dict(last)
    for name in {"maskmem_features", "obj_ptr"} & last.keys():
        merged[name] = last[name].clone()
        merged[name][chosen] = new[name].to(last[name].dtype)
    return merged


def to_device(output: Memory, device: torch.device) -> Memory:
    """The same memory on a device."""
    on_device = {name: value.to(device) for name, value in output.items() if isinstance(value, Tensor)}
    if "maskmem_pos_enc" in output:
        position = [each[:1].to(device) for each in output["maskmem_pos_enc"]]
        on_device["maskmem_pos_enc"] = _alike(position, len(on_device["obj_ptr"]))
    return on_device


def drop_features(output: Memory) -> None:
    """Keep the pointers alone."""
    output.pop("maskmem_features", None)
    output.pop("maskmem_pos_enc", None)


def _alike(position: list[Tensor], count: int) -> list[Tensor]:
    return [each[:1].expand(count, -1, -1, -1) for each in position]
