"""How a question is answered: the numbers of LangSplat's protocol, and what they may be changed to."""

from dataclasses import dataclass

CANONICAL = ("object", "things", "stuff", "texture")
"""Phrases that fit anything: what is asked for has to fit better than the best of them (paper, LERF, LangSplat)."""


@dataclass(frozen=True)
class QueryOptions:
    """How relevancy is computed and read (method_spec M2.4).

    Attributes:
        canonical: phrases that a query is compared with; at least one.
        temperature: t of the relevancy; the paper's formula has 1, LERF and LangSplat 10 (M7 no. 1); above 0.
        resolution: longer side of the picture in which codes are rendered and decoded [px]; 0, or more than the
            camera's, for the camera's own. Maps are then resized to the camera's, in which all else happens.
        min_coverage: a pixel is seen at a level where more of it is covered by something with a code there; of less
            nothing can be said. Above 0, below 1.
        smoothing_px: side of the box filter [px]; 1 for none. LangSplat has 30 in pictures of about 1,000 to
            1,400 px; smaller pictures want a smaller one.
        segmentation_threshold: a pixel belongs to the mask where its value, brought to 0..1 over the picture, is
            larger (M7 no. 38).
        majority_px: side of the square in which the mask takes the majority [px], odd; 1 for none.

    Raises:
        ValueError: a number is out of its range.
    """

    canonical: tuple[str, ...]
    temperature: float
    resolution: int
    min_coverage: float
    smoothing_px: int
    segmentation_threshold: float
    majority_px: int

    def __post_init__(self) -> None:
        ranges = {
            "canonical": len(self.canonical) >= 1,
            "temperature": 0.0 < self.temperature < float("inf"),
            "resolution": self.resolution >= 0,
            "min_coverage": 0.0 < self.min_coverage < 1.0,
            "smoothing_px": self.smoothing_px >= 1,
            "segmentation_threshold": 0.0 <= self.segmentation_threshold < 1.0,
            "majority_px": self.majority_px >= 1 and self.majority_px % 2 == 1,
        }
        for name, good in ranges.items():
            if not good:
                raise ValueError(f"{name} = {getattr(self, name)!r} is out of its range")


LANGSPLAT = QueryOptions(
    canonical=CANONICAL,
    temperature=10.0,
    resolution=0,
    min_coverage=0.01,
    smoothing_px=30,
    segmentation_threshold=0.7,
    majority_px=7,
)
"""LangSplat's protocol, which the paper follows; LangSplat itself also decodes what nothing covers."""
