"""Things keep the outlines of their masks in the frames that have some."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Labels = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class NamedMasks:
    """The things that V masks of segments.zarr show.

    Attributes:
        row: (V,) int64 frame of each mask.
        instance: (V,) int64 its number in segments.zarr.
        thing: (V,) int64, -1 for a mask that shows none.
    """

    row: NDArray[np.int64]
    instance: NDArray[np.int64]
    thing: NDArray[np.int64]

    @staticmethod
    def concatenate(parts: list["NamedMasks"]) -> "NamedMasks":
        """Join the masks of several levels."""
        return NamedMasks(
            *(np.concatenate([getattr(one, name) for one in parts]) for name in ("row", "instance", "thing"))
        )

    def drawn(self, row: int, labels: Labels) -> Labels:
        """(L, H, W) thing that each pixel's mask shows in a frame, -1 for none, from its labels in segments.zarr."""
        mine = self.row == row
        instance = self.instance[mine]
        # Label -1 indexes the last entry.
        table = np.full(int(labels.max(initial=-1)) + 2, -1, np.int32)
        shown = instance < len(table) - 1
        table[instance[shown]] = self.thing[mine][shown]
        return table[labels]


def keep_outlines(rendered: Labels, drawn: Labels) -> Labels:
    """Draw masks over the rendered things of a frame. Where a thing has a mask, its rendering counts nowhere.

    Args:
        rendered, drawn: (L, H, W) things, -1 for none.
    """
    # Thing -1 indexes the last entry.
    has_mask = np.zeros(int(max(rendered.max(initial=-1), drawn.max(initial=-1))) + 2, bool)
    has_mask[drawn] = True
    has_mask[-1] = False
    return np.where(drawn >= 0, drawn, np.where(has_mask[rendered], np.int32(-1), rendered))
