"""What a try is: something broken in a private folder, and the command that meets it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.pipeline.stages import STAGES

Words = Sequence[object]

UNREAD = "what is broken is not read for it: the result is the same, bit by bit"


@dataclass(frozen=True)
class Sandbox:
    """A private copy of the finished scene, with other people's files beside it.

    Attributes:
        folder: the working directory, with ``config`` and, below ``results``, the scene.
        outside: a folder that nothing may touch; commands in names would make ``canary`` in it.
    """

    folder: Path
    outside: Path

    @property
    def scene(self) -> Path:
        """The finished scene."""
        return self.folder / "results/adt/scene1"

    @property
    def recording(self) -> Path:
        """Its recording, in ADT's format."""
        return self.scene / "recording"

    @property
    def new(self) -> Path:
        """What commands that write an artifact are asked to make."""
        return self.folder / "new.zarr"

    @property
    def made(self) -> Path:
        """What a command made under the name ``new``, with the suffix of its format; ``new`` where it made nothing."""
        return next(self.folder.glob("new.*"), self.new)

    @property
    def canary(self) -> Path:
        """Made by no command but one that a name or a value smuggles in."""
        return self.outside / "canary"


@dataclass(frozen=True)
class Case:
    """One bad input.

    Attributes:
        family: row of the table.
        name: what is broken.
        command: breaks it, and returns the words of the command line or, where a function of egosplat meets it before
            any command does, that function.
        named: the message holds one of these.
        fine: why it may be accepted; empty where that would be a defect.
        undisturbed: the same command without anything broken, whose result an accepted one has to equal.
        scene: whether the finished scene is needed, not its configuration alone.
    """

    family: str
    name: str
    command: Callable[[Sandbox], Words | Callable[[], object]]
    named: tuple[str, ...]
    fine: str = ""
    undisturbed: Callable[[Sandbox], Words] | None = None
    scene: bool = True


def flags(stage: str, **values: object) -> list[object]:
    """Words of a stage's command: ``flags("frames", format="adt")``."""
    return [
        stage.replace("_", "-"),
        *(word for name, value in values.items() for word in (f"--{name.replace('_', '-')}", value)),
    ]


def stage_flags(stage: str, box: Sandbox, **changes: object) -> list[object]:
    """The command of a stage on the sandbox's scene, short where training is concerned."""
    names = {name: STAGES[name].output if name in STAGES else f"{name}.zarr" for name in STAGES[stage].inputs}
    given: dict[str, object] = {name: box.scene / file for name, file in names.items()}
    if "recording" in given:
        given["recording"] = box.recording
    given["output"] = box.new.with_suffix(Path(STAGES[stage].output).suffix)
    return flags(stage, **(given | SHORT.get(stage, {}) | changes))


SHORT: dict[str, dict[str, object]] = {
    "frames": {"format": "adt", "resolution": 96, "evaluation_frames": 3},
    "segments": {"segmenter": "classical"},
    "transient": {"iterations": 2, "resolution": 48, "input_size": 64},
    "splats": {"masking": "none", "iterations": 2, "max_points": 50},
    "survey": {"min_view_change_deg": 0},
}
"""Keys with which a stage takes a second or two."""
