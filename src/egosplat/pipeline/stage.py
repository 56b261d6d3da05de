"""What a stage is: its code, inputs, output and options."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Choice:
    """Modules of which a stage loads one, by a value; only that one is a part of its code.

    Attributes:
        by: what the value is, for errors; ``variants.chosen_value`` gets the value of a scene.
        modules: names of modules by value.
    """

    by: str
    modules: dict[str, str]


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    Attributes:
        name: name of the stage and of its configuration section, if it has keys.
        module: module whose function ``run`` writes the output.
        help: one-line help of its command.
        output: name of the file or folder that it writes in the scene's folder.
        inputs: inputs that it always reads: names of stages (their outputs) or of ``PATHS``.
        optional: inputs that some configurations need, with the condition as text, by name of the stage.
        libraries: distributions whose version changes the output.
        options: class of its options, MODULE:CLASS; empty for a stage without keys.
        scene: values that it takes from the table of scenes and the variant: ``format`` of the recording, ``title`` for
            pages, ``method``, the published method that a variant stands for, and what ``metrics.json`` tells of the
            configuration: ``preset``, and ``world_seed`` and ``camera`` of a synthetic apartment.
        modules: modules of which it loads one with ``load_module``.
        by_chunks: whether jobs can work on chunks of its frames. ``run`` takes ``chunk`` and ``gather`` then, see ``Work``.
        memory: main memory to request without a GPU [MB], and more for each gigapixel of the frames.
        minutes: time to request on two cores, ten times what is expected [min], and more for each gigapixel.
        before: of a stage of another package, the name of the stage that it stands before.
        aside: whether only methods of others need it.
    """

    name: str
    module: str
    help: str
    output: str
    inputs: tuple[str, ...] = ()
    optional: Mapping[str, str] = field(default_factory=dict)
    libraries: tuple[str, ...] = ()
    options: str = ""
    scene: tuple[str, ...] = ()
    modules: Choice | None = None
    by_chunks: bool = False
    memory: tuple[float, float] = (2000, 600)
    minutes: tuple[float, float] = (30, 100)
    before: str = ""
    aside: bool = False
