"""What the segmenter without weights is told."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClassicalOptions:
    """How images are cut into regions, and how regions are followed; tuned on synthetic apartments.

    A difference is a distance in CIELAB (about 2 is just noticeable, black to white is 100 times
    ``lightness_weight``). An area is a share of the valid part of the image, so that the size of the image
    does not matter.

    Attributes:
        side: longest side that work is done at [px]; larger images are made smaller, and their labels larger.
        smoothing: of the image before its superpixels are found, a Gaussian's sigma at ``side`` [px].
        granularity: of superpixels (Felzenszwalb and Huttenlocher's k): the larger, the larger they are
            [difference x area].
        least_area: smaller regions are merged into the neighbour that is most like them.
        least_width: so are thinner ones, at ``side`` [px].
        lightness_weight: of a difference in lightness, against 1 for the two colour axes.
        texture_weight: of a difference in how strong the texture is.
        edge_weight: of the gradient across the common boundary, in differences per (difference/px).
        edge_scale: of that gradient, a Gaussian's sigma at ``side`` [px].
        size_power: how much sooner small regions are merged: a difference counts as
            ``difference * (100 * a * b / (a + b)) ** size_power`` between areas a and b.
        contact_weight: how much sooner enclosed regions are merged: a difference counts less by this share where
            the common boundary is the whole outline of one of the two.
        subpart, part, whole: regions of the level differ by at least this much, for areas of one percent.
        flow_side: longest side that optical flow is computed at [px].
        flow_error: forward and backward flow may miss each other by this much at ``flow_side`` [px], and by a
            tenth of their length.
        colour_error: a pixel may differ from where it was by this much; the light may change, too [difference].
        least_support: a fine region takes a label that at least this share of its pixels brings along.
        purity: and that at least this share of its pixels with a label agrees on; else pixels keep their own.
        new_area: an uncovered region that is at least this large becomes a new track.
    """

    side: int = 384
    smoothing: float = 0.7
    granularity: float = 2e-5
    least_area: float = 3e-4
    least_width: float = 1.5
    lightness_weight: float = 0.4
    texture_weight: float = 2.0
    edge_weight: float = 0.5
    edge_scale: float = 4.0
    size_power: float = 0.5
    contact_weight: float = 0.5
    subpart: float = 3.5
    part: float = 12.0
    whole: float = 29.0
    flow_side: int = 384
    flow_error: float = 8.0
    colour_error: float = 15.0
    least_support: float = 0.15
    purity: float = 0.7
    new_area: float = 1e-3

    def __post_init__(self) -> None:
        """Raises: ValueError: a number makes no sense."""
        for name, value in vars(self).items():
            if not value >= 0:
                raise ValueError(f"{name} must not be negative: {value}")
        if self.side < 1 or self.flow_side < 1:
            raise ValueError(f"side and flow_side must be at least 1 px: {self.side}, {self.flow_side}")
        if not self.subpart <= self.part <= self.whole:
            raise ValueError(f"levels must rise: {self.subpart} <= {self.part} <= {self.whole} does not hold")
        for name in ("least_area", "contact_weight", "least_support", "purity", "new_area"):
            if getattr(self, name) > 1:
                raise ValueError(f"{name} is a share, at most 1: {getattr(self, name)}")
