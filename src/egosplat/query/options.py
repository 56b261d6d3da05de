"""Options of queries, with the values of LangSplat's protocol."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from egosplat.errors import UserError

# Phrases that fit any object; relevancy compares each query with them (paper, LERF, LangSplat).
CANONICAL = ("object", "things", "stuff", "texture")


@dataclass(frozen=True)
class QueryOptions:
    """How to compute and read relevancy (docs/method.md#queries).

    Attributes:
        canonical: phrases to compare each query with; at least one.
        temperature: t of the relevancy, above 0. The paper's formula has 1, LERF and LangSplat 10.
        resolution: longer side of rendered and decoded codes [px]; 0 for the camera's. Maps are then resized to the
            camera's size.
        min_coverage: minimum share of a pixel covered by Gaussians with a code; below it the pixel has no relevancy.
            Above 0, below 1.
        box_filter: side of the box filter, as a share of the image's longer side; 0 for none.
        segmentation_threshold: minimum relevancy of a mask's pixels, after normalization to 0..1 over the image.
        majority_filter: side of the mask's majority filter, as a share of the image's longer side; 0 for none.
        min_score: minimum score of an answer; below it the query is refused.

    Raises:
        ValueError: a value is out of its range.
    """

    canonical: tuple[str, ...]
    temperature: float
    resolution: int
    min_coverage: float
    box_filter: float
    segmentation_threshold: float
    majority_filter: float
    min_score: float

    def __post_init__(self) -> None:
        ranges = {
            "canonical": len(self.canonical) >= 1,
            "temperature": 0.0 < self.temperature < float("inf"),
            "resolution": self.resolution >= 0,
            "min_coverage": 0.0 < self.min_coverage < 1.0,
            "box_filter": 0.0 <= self.box_filter <= 1.0,
            "segmentation_threshold": 0.0 <= self.segmentation_threshold < 1.0,
            "majority_filter": 0.0 <= self.majority_filter <= 1.0,
            "min_score": 0.0 <= self.min_score <= 1.0,
        }
        for name, good in ranges.items():
            if not good:
                raise ValueError(f"{name} = {getattr(self, name)!r} is out of range")

    def changed(self, **keys: Any) -> "QueryOptions":
        """Get these options with other values for some keys.

        Raises:
            UserError: a key is unknown, or a value is out of its range.
        """
        if unknown := keys.keys() - vars(self).keys():
            raise UserError(f"query.{min(unknown)}: is no key; known are {', '.join(vars(self))}")
        try:
            return replace(self, **keys)
        except (TypeError, ValueError) as error:
            raise UserError(f"query: {error}") from None

    def refusal(self, score: float, untaught: Sequence[str]) -> str | None:
        """The reason why a query has no answer; None if it has one.

        Args:
            score: score of the best match, 0..1.
            untaught: words of the query that the model was not trained on.
        """
        # First, because the score of an untrained word is meaningless.
        if untaught:
            words = ", ".join(f'"{word}"' for word in dict.fromkeys(untaught))
            return f"not found: the OpenCLIP checkpoint was not trained on {words}"
        return f"not found: the best match is below {self.min_score:.2f}" if score < self.min_score else None

    def box_filter_px(self, longer: int) -> int:
        """Side of the box filter [px] for a longer side [px]; at least 1, which changes nothing."""
        return max(1, round(self.box_filter * longer))

    def majority_px(self, longer: int) -> int:
        """Side of the majority filter [px] for a longer side [px]: the nearest odd number."""
        # An even square has no middle pixel.
        return 2 * int(self.majority_filter * longer / 2) + 1


# LangSplat's protocol, used by the paper: filters of 30 and 7 pixels at 1408. LangSplat itself has no
# ``min_coverage``.
LANGSPLAT = QueryOptions(
    canonical=CANONICAL,
    temperature=10.0,
    resolution=0,
    min_coverage=0.01,
    box_filter=0.0213,
    segmentation_threshold=0.7,
    majority_filter=0.005,
    min_score=0.5,
)
