"""The tracks of each level, and the tracks that levels share."""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from egosplat.artifacts.checkpoint import State
from egosplat.segments.instances import Overlaps
from egosplat.segments.propagation import Group, to_device

# Numbers of K instances of a level and their (K, M, M) float32 logits, or bool masks, in one frame.
LevelMasks = tuple[list[int], Tensor]


@dataclass
class Level:
    """State of one level while a video is tracked.

    Attributes:
        groups: objects that are tracked for this level.
        shared: by instance, the number of an equal instance of another level, which is tracked for both.
        overlaps: between the masks of the level's instances.
    """

    groups: list[Group] = field(default_factory=list)
    shared: dict[int, int] = field(default_factory=dict)
    overlaps: Overlaps = field(default_factory=Overlaps)

    @property
    def instances(self) -> int:
        """Number of instances of the level."""
        return sum(len(group.ids) for group in self.groups) + len(self.shared)

    def state_dict(self) -> State:
        """The state as tensors, numbers, lists and dictionaries."""
        return {
            "groups": [vars(group) for group in self.groups],
            "shared": self.shared,
            "overlaps": self.overlaps.state_dict(),
        }

    def load_state_dict(self, state: State, device: torch.device) -> None:
        """Replace the state by that of a ``state_dict``, on a device."""
        self.groups = [_group(saved, device) for saved in state["groups"]]
        self.shared = state["shared"]
        self.overlaps.load_state_dict(state["overlaps"])


def _group(saved: State, device: torch.device) -> Group:
    group = Group(saved["ids"], saved["first_frame"], to_device(saved["begun"], device))
    group.recent = {frame: to_device(output, device) for frame, output in saved["recent"].items()}
    group.unseen = saved["unseen"]
    return group


def add_shared(levels: list[Level], seen: list[list[LevelMasks]]) -> None:
    """Append to each level's masks, in place, those of instances that are tracked at another level."""
    # By number over all levels: an instance may share the track of another level's.
    logits = {
        number: row for found in seen for ids, rows in found for number, row in zip(ids, rows, strict=True)
    }
    for level, found in zip(levels, seen, strict=True):
        ids = [number for number, tracked in level.shared.items() if tracked in logits]
        if ids:
            found.append((ids, torch.stack([logits[level.shared[number]] for number in ids])))


def stack_masks(seen: list[LevelMasks], inside: Tensor) -> LevelMasks:
    """Join the groups of a level: all numbers, and (K, M, M) bool masks within (M, M) ``inside``."""
    if not seen:
        return [], inside.new_zeros(0, *inside.shape)
    masks = torch.cat([logits > 0 for _, logits in seen])
    return [number for ids, _ in seen for number in ids], masks & inside
