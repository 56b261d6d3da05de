"""Options of the classical segmenter."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClassicalOptions:
    """Parameters of segmentation and tracking without learned weights, tuned on synthetic apartments.

    A difference is a distance in CIELAB (about 2 is just noticeable, black to white is 100 times
    ``lightness_weight``). An area is a share of the image's valid pixels.

    Attributes:
        side: longest side at which images are segmented [px]; larger images are reduced, their labels enlarged.
        smoothing: sigma of the Gaussian blur before superpixels are computed, at ``side`` [px].
        granularity: Felzenszwalb and Huttenlocher's k [difference x area]; larger values give larger superpixels.
        least_area: smaller regions are merged into their most similar neighbor.
        least_width: thinner regions are, too; at ``side`` [px].
        lightness_weight: weight of a difference in lightness; that of the two color axes is 1.
        texture_weight: weight of a difference in texture strength.
        edge_weight: weight of the gradient across the common boundary, in differences per (difference/px).
        edge_scale: sigma of that gradient's Gaussian blur, at ``side`` [px].
        size_power: preference for merging small regions: a difference between areas a and b counts as
            ``difference * (100 * a * b / (a + b)) ** size_power``.
        contact_weight: preference for merging enclosed regions: a difference is reduced by this share if the common
            boundary is the whole outline of one of them.
        subpart, part, whole: least difference between regions of the level, for areas of one percent.
        flow_side: longest side at which optical flow is computed [px].
        flow_error: largest gap between forward and backward flow at ``flow_side`` [px], besides a tenth of their
            length.
        color_error: largest color change of a pixel between frames [difference].
        least_support: a fine region takes a label only if this share of its pixels has one,
        purity: and if this share of those agrees; else pixels keep their own labels.
        new_area: an uncovered region becomes a new track if it is at least this large.
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
    color_error: float = 15.0
    least_support: float = 0.15
    purity: float = 0.7
    new_area: float = 1e-3
