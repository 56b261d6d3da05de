"""The controls of one window. They hold no state but their values."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from egosplat.viewer.wording import CLICK, LEGEND, WAITING, plain

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi

# What colors show; the names of instances' levels follow.
OWN, FIT = "photographs", "fit to the query"

# Levels to show besides those of the scene.
ANSWERS_LEVEL, BEST_LEVEL = "of the answer", "best of all"

# The choices that stand for none.
NO_WORD, NO_SCENE = "choose a word", "nothing"


@dataclass(frozen=True, eq=False)
class AskTab:
    """Controls of questions; each is a handle of viser."""

    query: Any
    suggestions: Any
    answer: Any
    jump: Any
    colors: Any
    legend: Any
    level: Any
    threshold: Any
    only: Any
    clicked: Any


@dataclass(frozen=True, eq=False)
class FramesTab:
    """Controls of the recording's frames."""

    frame: Any
    follow: Any
    tint: Any
    picture: Any
    told: Any
    cameras: Any
    thumbnails: Any


@dataclass(frozen=True, eq=False)
class SceneTab:
    """Controls of the scene and of the drawing; ``scene`` and ``compare`` are None for a single scene."""

    scene: Any
    compare: Any
    browser: Any
    about: Any


@dataclass(frozen=True, eq=False)
class Panel:
    """All controls of a window."""

    ask: AskTab
    frames: FramesTab
    scene: SceneTab

    def show_scene(
        self,
        levels: Sequence[str],
        instance_levels: Sequence[str],
        words: Sequence[str],
        threshold: float | None,
    ) -> None:
        """Fit the choices to a scene.

        Args:
            levels: levels of its answers; none where it cannot be asked.
            instance_levels: levels of its instances in 3D.
            words: suggestions.
            threshold: relevancy from which a Gaussian fits; None where the scene cannot be asked.
        """
        if threshold is not None:
            self.ask.threshold.value = threshold
        self.ask.level.options = (ANSWERS_LEVEL, BEST_LEVEL, *levels)
        self.ask.level.value = ANSWERS_LEVEL
        self.ask.colors.options = (OWN, FIT, *map(instances_choice, instance_levels))
        self.ask.colors.value = OWN
        self.ask.suggestions.options = (NO_WORD, *words)
        self.ask.suggestions.value = NO_WORD
        for control in (
            self.ask.query,
            self.ask.suggestions,
            self.ask.jump,
            self.ask.level,
            self.ask.threshold,
        ):
            control.disabled = not levels
        self.ask.only.disabled = not levels


def instances_choice(level: str) -> str:
    """The choice of colors that shows the instances of a level."""
    return f"instances: {level}"


def build_panel(client: "ClientHandle", scenes: Sequence[str], frames: int, something_moves: bool) -> Panel:
    """Add the controls to a window.

    Args:
        scenes: names of the scenes; the first one is shown.
        frames: number of frames of the first scene.
        something_moves: whether it has masks of what moves.
    """
    gui = client.gui
    gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    gui.main_panel.dock_right()
    tabs = gui.add_tab_group()
    with tabs.add_tab("Ask"):
        ask = _ask_tab(gui)
    with tabs.add_tab("Frames"):
        recording = _frames_tab(gui, frames, something_moves)
    with tabs.add_tab("Scene"):
        scene = _scene_tab(gui, scenes)
    return Panel(ask, recording, scene)


def _ask_tab(gui: "GuiApi") -> AskTab:
    return AskTab(
        query=gui.add_text("Query", "", hint="An object in a few words, such as: wooden chair"),
        suggestions=gui.add_dropdown("Suggestions", (NO_WORD,), initial_value=NO_WORD),
        answer=gui.add_html(plain(WAITING)),
        jump=gui.add_button("Jump to the answer", disabled=True, hint="Again: to the next answer"),
        colors=gui.add_dropdown("Colors", (OWN, FIT), initial_value=OWN),
        legend=gui.add_html(LEGEND),
        level=gui.add_dropdown("Level", (ANSWERS_LEVEL,), initial_value=ANSWERS_LEVEL),
        threshold=gui.add_slider(
            "Threshold",
            min=0.0,
            max=0.99,
            step=0.01,
            initial_value=0.5,
            hint="Relevancy from which a Gaussian fits; 0.5 fits as well as any word for any object",
        ),
        only=gui.add_checkbox("Show only what fits", False),
        clicked=gui.add_html(plain(CLICK)),
    )


def _frames_tab(gui: "GuiApi", frames: int, something_moves: bool) -> FramesTab:
    hint = None if something_moves else "Nothing is masked in this scene"
    return FramesTab(
        frame=gui.add_slider("Frame", min=0, max=max(1, frames - 1), step=1, initial_value=0),
        follow=gui.add_checkbox("Follow the wearer", True, hint="The view goes where the frame was taken"),
        tint=gui.add_checkbox("Tint what moves", something_moves, disabled=not something_moves, hint=hint),
        picture=gui.add_image(np.zeros((2, 2, 3), np.uint8), format="jpeg"),
        told=gui.add_html(""),
        cameras=gui.add_checkbox("Cameras of the frames", False),
        thumbnails=gui.add_checkbox("Cameras with pictures", False),
    )


def _scene_tab(gui: "GuiApi", scenes: Sequence[str]) -> SceneTab:
    several = len(scenes) > 1
    hint = "The left half of the picture shows the scene, the right half the other one"
    return SceneTab(
        scene=gui.add_dropdown("Scene", tuple(scenes), initial_value=scenes[0]) if several else None,
        compare=gui.add_dropdown("Compare with", (NO_SCENE, *scenes), initial_value=NO_SCENE, hint=hint)
        if several
        else None,
        browser=gui.add_checkbox(
            "Draw in the browser", False, hint="Faster with a GPU in this computer, and less exact"
        ),
        about=gui.add_html(""),
    )
