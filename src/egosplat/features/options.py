"""Options of the stages ``view_features`` and ``features``."""

from typing import Annotated, Literal

from egosplat.pipeline.options import READING, Auto, Count, Share
from egosplat.pipeline.shared_options import ClipOptions, DeviceOptions, SeedOptions, SetOptions


class ViewFeaturesOptions(ClipOptions, DeviceOptions):
    """OpenCLIP feature of each instance in each training frame that shows it."""

    min_area: Annotated[Share, READING] = 0.0002
    """Smallest mask that is encoded, as a fraction of the frame (docs/method.md#smallest-view). 0 encodes instances
    of any size. Tiny crops carry little information and cost as much as large ones."""

    cut: Annotated[Literal["mask", "hull"], READING] = "hull"
    """What a crop shows. mask: the pixels of the mask, as in the paper. hull: those of its convex hull, so that the
    holes and ragged edges of the small SAM2's masks do not show. Answers keep the outlines of the masks."""

    max_views: Count | None = None
    """Largest number of encoded views per instance, evenly spaced over its frames. null encodes all. Fewer take
    proportionally less time; the remaining frames then use the consistent feature alone."""


class FeaturesOptions(SetOptions, SeedOptions):
    """Aggregation of each instance's view features into one consistent feature, and compression to codes."""

    mad_norm: Annotated[Literal["element", "none"], READING] = "element"
    """Distance of a view from the median of its instance's views (docs/method.md#deviation). element: each channel
    by itself. none: no outlier test, a plain mean."""

    supervision: Literal["inliers", "average", "consistent", "view"] = "inliers"
    """Training target of the Gaussians (docs/method.md#supervision-average). average: mean of the view's feature and
    the consistent feature, as in the paper. inliers: the same, but outlier views take the consistent feature alone, and
    without published models, views whose track switched to another object keep their own. consistent: the consistent
    feature alone. view: the view's feature alone, as in LangSplat, without aggregation."""

    compression: Literal["linear", "autoencoder", "none"] = "linear"
    """Compression of features to the codes of the Gaussians. linear: mean and orthonormal basis of the scene. It
    takes no time, and with enough dims loses nothing. autoencoder: LangSplat's, trained on the scene, for few dims.
    none: as many channels as the features have."""

    dims: Count | Auto = "auto"
    """Channels of a code at each level. The paper uses 3, which makes different objects similar
    (docs/method.md#code-dimensions). Time, memory and disk of the stage language grow with it, and of the stage
    splats if splats.language is joint. auto takes the fewest that a linear basis of the scene's features needs to
    give 95 % of the decoded view features a cosine of 0.99 with the original, about 40 of the bundled OpenCLIP's
    128."""

    epochs: Annotated[Count, READING] = 100
    """Epochs of the autoencoder over all view features. LangSplat uses 100. Time grows with it."""
