"""Options of queries, with the values of LangSplat's protocol."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field

from egosplat.pipeline.messages import make_options
from egosplat.pipeline.model_sets import DEFAULTS, PUBLISHED
from egosplat.pipeline.options import READING, Natural, Options, Positive, Share, Text
from egosplat.pipeline.shared_options import BackendOptions, DeviceOptions

# Phrases that fit any object; relevancy compares each query with them (paper, LERF, LangSplat).
CANONICAL = ("object", "things", "stuff", "texture")

# Things that an answer of the whole scene lists, if it is not told how many.
MOST = 3

# Keys of ``query`` that move a thing's score, or are a limit of the user's own: a fit holds for the values it was made with.
HELD = ("canonical", "temperature", "box_filter", "segmentation_threshold", "min_score", "size_weight")


class QueryOptions(Options, section="query"):
    """Answers to text queries, in the benchmark and in egosplat query."""

    readout: Annotated[Literal["gaussians", "pixels"], READING] = "gaussians"
    """What a view is asked by. gaussians: the relevancy of each Gaussian is rendered, and a mask is what those above
    the threshold fill. pixels: codes are rendered and pixels decoded, LangSplat's way and its masks. Methods that
    yield maps only are always read by pixels (docs/method.md#query-views)."""

    box_filter: Annotated[Share, READING] = 0.0213
    """Side of the box filter that averages relevancy, as a fraction of the frame's longer side; 0 is none.
    LangSplat's 30 pixels are 0.0213 of the paper's 1408. Larger finds large objects more reliably and small ones
    less."""

    segmentation_threshold: Annotated[float, Field(ge=0, lt=1), READING] = 0.7
    """Relevancy above which a Gaussian, or a pixel, belongs to the mask, after scaling the frame's relevancy to 0..1.
    LangSplat uses 0.7 (docs/method.md#segmentation-threshold). Higher makes smaller masks."""

    majority_filter: Annotated[Share, READING] = 0.005
    """Side of the majority filter on masks, as a fraction of the frame's longer side; 0 is none. LangSplat's 7
    pixels are 0.005 of 1408. Larger removes specks and rounds corners."""

    canonical: Annotated[tuple[Text, ...], Field(min_length=1)] = CANONICAL
    """Phrases that describe any object. A query must match better than the best of them for a relevancy above 0.5.
    The paper uses LERF's."""

    temperature: Annotated[Positive, READING] = 10.0
    """Steepness of the relevancy as a function of similarity. LERF and LangSplat use 10, the paper's formula 1
    (docs/method.md#temperature). It does not move the maximum before the box filter, and hardly after it."""

    size_weight: Annotated[float, Field(ge=0, le=2)] = 0.25
    """Weight of the sizes of things as evidence for names (docs/answers.md#sizes); 0 asks by looks alone."""

    resolution: Natural = 0
    """Longer side in pixels at which codes are rendered and decoded; never larger than the frames. 0 is the frames'
    size. Time and memory per view grow with its square; smaller locates small objects less exactly."""

    min_score: Share = 0.7
    """Smallest score, 0 to 1, of an answer that is found, where no calibration holds: in a single view, with models
    that have none, and with another value than this (docs/answers.md#grades). A score of 0.5 means as similar as the
    best canonical phrase. 0 accepts everything. docs/models.md has the value of each set of models."""

    present_share: Annotated[float, Field(gt=0, le=1)] = 0.7
    """Share of the words you ask that name something in the scene. Probabilities and grades assume it
    (docs/answers.md#grades). A higher share finds more: set it if you ask for what you saw."""

    def box_filter_px(self, longer: int) -> int:
        """Side of the box filter [px] for a longer side [px]; at least 1, which changes nothing."""
        return max(1, round(self.box_filter * longer))

    def majority_px(self, longer: int) -> int:
        """Side of the majority filter [px] for a longer side [px]: the nearest odd number."""
        # An even square has no middle pixel.
        return 2 * int(self.majority_filter * longer / 2) + 1


class AskingOptions(QueryOptions, BackendOptions, DeviceOptions):
    """Everything that an answer depends on beside the scene."""

    def change_keys(self, **keys: Any) -> Self:
        """Make a copy with other values for some keys (UserError: names the first that is unknown or has a forbidden value)."""
        options = make_options(type(self), dict(self) | keys, "a query", "query")
        assert isinstance(options, type(self))
        return options

    def suit(self, clip_model: str, **keys: Any) -> Self:
        """Set keys, and those of ``query`` that nobody set to the defaults of the set of models with this OpenCLIP, by which features
        were made; another one than those of the sets is asked as the published ones."""
        defaults = DEFAULTS.get(clip_model, DEFAULTS[PUBLISHED])["query"]
        unset = {key: value for key, value in defaults.items() if key not in self.model_fields_set}
        return self.change_keys(**unset | keys)
