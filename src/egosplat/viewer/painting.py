"""The Gaussians in the colors that the controls of a window ask for."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.report.sheets.instances_sheet import palette
from egosplat.viewer.panel import ANSWERS_LEVEL, BEST_LEVEL, FIT, AskTab, instances_choice
from egosplat.viewer.pictures import Painted, heat, instances
from egosplat.viewer.questions import Reply
from egosplat.viewer.world import World


class Painter:
    """Paints scenes for one window; it remembers the last colors of each scene."""

    def __init__(self, controls: AskTab) -> None:
        self._controls = controls
        self._painted: dict[str, tuple[Any, Painted]] = {}

    def paint(self, world: World, reply: Reply | None) -> Painted:
        """Paint a scene.

        Args:
            reply: the answer to show, or None.
        """
        ask = self._controls
        wanted = (ask.colors.value, ask.level.value, ask.threshold.value, ask.only.value, reply)
        before = self._painted.get(world.name)
        if before is not None and before[0] == wanted:
            return before[1]
        fit = None if reply is None or reply.refusal else self._fit(world, reply)
        painted = self._colored(world, fit)
        if ask.only.value and fit is not None:
            painted = painted.only(fit >= ask.threshold.value)
        self._painted[world.name] = (wanted, painted)
        return painted

    def _colored(self, world: World, fit: NDArray[np.float32] | None) -> Painted:
        colors, own = self._controls.colors.value, world.plain.colors
        if colors == FIT and fit is not None:
            return world.plain.colored(heat(own, fit, self._controls.threshold.value))
        for level, name in enumerate(world.instance_levels):
            if colors == instances_choice(name):
                owners = world.owners(level)
                return world.plain.colored(instances(own, owners, palette(int(owners.max()) + 1)))
        return world.plain

    def _fit(self, world: World, reply: Reply) -> NDArray[np.float32]:
        """(N,) relevancy at the chosen level."""
        chosen = self._controls.level.value
        if chosen == BEST_LEVEL:
            return reply.fit.max(axis=0)
        if chosen == ANSWERS_LEVEL or world.questions is None:
            return reply.fit[reply.level or 0]
        return reply.fit[world.questions.levels.index(chosen)]
