"""Options of the stage ``metrics``."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from egosplat.pipeline.options import READING, UNIQUE, Options, Share, Text
from egosplat.pipeline.shared_options import ClipOptions
from egosplat.query.options import AskingOptions


class PresenceOptions(Options, section="presence"):
    """Queries to the whole scene for objects that it does not have."""

    # fmt: off
    negatives: Annotated[tuple[Text, ...], UNIQUE] = (
        "armchair", "basketball", "bed frame", "book", "bookcase", "bottle", "bowl", "box", "cabinet",
        "candle", "clothes basket", "coaster", "coffee table", "couch", "cup", "cutting board", "desk",
        "desk clock", "desk lamp", "dining chair", "dining table", "figurine", "house plant",
        "laptop computer", "magazine", "mattress", "pillow", "plate", "pot", "refrigerator",
        "remote control", "shelf", "side table", "speaker", "step stool", "tea kettle", "television",
        "tissue box", "toaster", "toy", "trash can", "tv stand", "vase", "wall clock", "bathtub", "bicycle",
        "car", "elephant", "fish tank", "giraffe", "guitar", "horse", "lawn mower", "piano",
        "sewing machine", "spaceship", "surfboard", "toilet", "traffic light", "umbrella",
    )
    # fmt: on
    """Phrases of absent objects, queried in the whole scene to measure false answers. Those that the recording's
    annotations name are left out. The names are ADT's; do not add another name of an object that the scene has."""


class ScoringOptions(Options, section="metrics"):
    """Selection of the benchmark's queries, and their scoring."""

    min_area: Annotated[Share, READING] = 0.001
    """Smallest fraction of an annotated frame that a category's instances must cover to be queried there, for
    static and dynamic instances separately (docs/method.md#smallest-target). The paper names no limit; EgoLifter
    uses 0.001. Smaller adds more and harder queries."""

    excluded: tuple[Text, ...] = ("shelter",)
    """Categories that are not queried, by their names in the recording's annotations. ADT's shelter is the room
    itself."""

    masks: Annotated[Literal["threshold", "classes"], READING] = "threshold"
    """Which pixels are a query's mask. threshold: those above query.segmentation_threshold, as in LangSplat's
    benchmark. classes: those where it is the most relevant of all categories of the recording, as in 3D-OVS's."""

    held_out: Literal["corrected", "given"] = "corrected"
    """Poses and exposures with which frames are asked and rendered, where training corrects them. corrected: those of a
    held-out frame are fitted to it. given: those of the recording (docs/method.md#corrected-held-out)."""


class MetricsOptions(ScoringOptions, AskingOptions, PresenceOptions, ClipOptions):
    """How a scene is queried and scored."""


def recorded_options(record: Mapping[str, Any]) -> MetricsOptions:
    """Make the options that ``metrics.json`` records, to score on any device."""
    options = MetricsOptions.model_validate({name: record[name] for name in MetricsOptions.model_fields})
    return options.change(device="auto", backend="auto")
