"""What is followed at each level, and what one level shows of another's."""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from egosplat.artifacts.checkpoint import State
from egosplat.segments.instances import Overlaps
from egosplat.segments.memory import to_device
from egosplat.segments.propagation import Group

LevelMasks = tuple[list[int], Tensor]
"""Numbers of K instances and their (K, M, M) float32 logits, or bool masks, in one frame."""


@dataclass
class Level:
    """One level while the video is worked through.

    Attributes:
        groups: what is followed for this level.
        shared: for an instance that looks like one of another level, that one's number: it is followed for both.
        overlaps: of all instances of the level.
    """

    groups: list[Group] = field(default_factory=list)
    shared: dict[int, int] = field(default_factory=dict)
    overlaps: Overlaps = field(default_factory=Overlaps)

    @property
    def instances(self) -> int:
        """How many the level has."""
        return sum(len(group.ids) for group in self.groups) + len(self.shared)

    def state_dict(self) -> State:
        """All of it as tensors, numbers, lists and dictionaries."""
        return {
            "groups": [vars(group) for group in self.groups],
            "shared": self.shared,
            "overlaps": self.overlaps.state_dict(),
        }

    def load_state_dict(self, state: State, device: torch.device) -> None:
        """Take what ``state_dict`` gave in place of all that is there."""
        self.groups = [_group(saved, device) for saved in state["groups"]]
        self.shared = state["shared"]
        self.overlaps.load_state_dict(state["overlaps"])


def _group(saved: State, device: torch.device) -> Group:
    group = Group(saved["ids"], saved["first_frame"], to_device(saved["begun"], device))
    group.recent = {frame: to_device(output, device) for frame, output in saved["recent"].items()}
    group.unseen = saved["unseen"]
    return group


def add_shared(levels: list[Level], seen: list[list[LevelMasks]]) -> None:
    """Add to what is seen of each level what is followed for it at another."""
    logits = {
        number: row for found in seen for ids, rows in found for number, row in zip(ids, rows, strict=True)
    }
    for level, found in zip(levels, seen, strict=True):
        ids = [number for number, followed in level.shared.items() if followed in logits]
        if ids:
            found.append((ids, torch.stack([logits[level.shared[number]] for number in ids])))


def stack_masks(seen: list[LevelMasks], inside: Tensor) -> LevelMasks:
    """All numbers and (K, M, M) bool masks of a level in one frame, within (M, M) ``inside``."""
    if not seen:
        return [], inside.new_zeros(0, *inside.shape)
    masks = torch.cat([logits > 0 for _, logits in seen])
    return [number for ids, _ in seen for number in ids], masks & inside
