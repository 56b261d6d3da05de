"""What a stage is: its code, inputs, output and options."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline.

    Attributes:
        name: name of the stage and of its configuration section, if it has keys.
        module: module whose function ``run`` writes the output.
        help: one-line help of its command.
        output: name of the file or folder that it writes in the scene's folder.
        inputs: inputs that it always reads: names of stages (their outputs) or of ``PATHS``.
        optional: stages whose outputs some configurations need.
        libraries: distributions whose version changes the output.
        options: class of its options, MODULE:CLASS; empty for a stage without keys.
        scene: values that it takes from the table of scenes and the variant: ``format`` of the recording, ``title`` for
            pages, ``method``, the published method that a variant stands for, and what ``metrics.json`` tells of the
            configuration: ``preset``, and ``world_seed`` and ``camera`` of a synthetic apartment.
        by: what the value is by which it loads one of ``modules``, for errors; ``variants.chosen_value`` gets it for a scene.
        modules: modules by value. Only the one of a scene's value is a part of the stage's code.
        by_chunks: whether jobs can work on chunks of its frames, or on cells. ``run`` takes ``chunk`` and ``gather`` then, see ``Work``.
        request: main memory to request without a GPU [MB], and more for each gigapixel of the frames; and time to request on
            two cores, ten times what is expected [min], and more for each gigapixel.
        before: of a stage of another package, the name of the stage that it stands before.
        aside: whether only methods of others need it.
    """

    name: str
    module: str
    help: str
    output: str
    inputs: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()
    options: str = ""
    scene: tuple[str, ...] = ()
    by: str = ""
    modules: dict[str, str] = field(default_factory=dict)
    by_chunks: bool = False
    request: tuple[float, float, float, float] = (2000, 600, 30, 100)
    before: str = ""
    aside: bool = False
