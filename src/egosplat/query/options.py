"""How a question is answered: the numbers of LangSplat's protocol, and what they may be changed to."""

from dataclasses import dataclass

CANONICAL = ("object", "things", "stuff", "texture")
"""Phrases that fit anything: what is asked for has to fit better than the best of them (paper, LERF, LangSplat)."""


@dataclass(frozen=True)
class QueryOptions:
    """How relevancy is computed and read (docs/method.md#queries).

    Attributes:
        canonical: phrases that a query is compared with; at least one.
        temperature: t of the relevancy; the paper's formula has 1, LERF and LangSplat 10; above 0.
        resolution: longer side of the picture in which codes are rendered and decoded [px]; 0, or more than the
            camera's, for the camera's own. Maps are then resized to the camera's, in which all else happens.
        min_coverage: a pixel is seen at a level where more of it is covered by something with a code there; of less
            nothing can be said. Above 0, below 1.
        box_filter: side of the box filter, as a share of the picture's longer side; 0 for none.
        segmentation_threshold: a pixel belongs to the mask where its value, brought to 0..1 over the picture, is
            larger.
        majority_filter: side of the square in which the mask takes the majority_filter, as the same share; 0 for none.
        min_score: least score of an answer; below it there is nothing of the kind.

    Raises:
        ValueError: a number is out of its range.
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
                raise ValueError(f"{name} = {getattr(self, name)!r} is out of its range")

    def box_filter_px(self, longer: int) -> int:
        """Side of the box filter [px] in a picture with this longer side; at least 1, which filters nothing."""
        return max(1, round(self.box_filter * longer))

    def majority_px(self, longer: int) -> int:
        """The same of the majority's square: the odd number that is nearest, which has a middle."""
        return 2 * int(self.majority_filter * longer / 2) + 1


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
"""LangSplat's protocol, which the paper follows: squares of 30 and 7 pixels at the paper's 1408. LangSplat itself also
decodes what nothing covers."""
