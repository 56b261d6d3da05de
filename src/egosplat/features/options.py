"""Options of the stages ``view_features`` and ``features``."""

from typing import Annotated, Literal

from pydantic import Field

from egosplat.pipeline.options import READING, Auto, Count, Share
from egosplat.pipeline.shared_options import ClipOptions, DeviceOptions, SeedOptions


class ViewFeaturesOptions(ClipOptions, DeviceOptions):
    """OpenCLIP feature of each instance in each training frame that shows it."""

    min_area: Annotated[Share, READING] = 0.0002
    """Smallest mask that is encoded, as a fraction of the frame (docs/method.md#smallest-view). 0 encodes instances
    of any size. Tiny crops carry little information and cost as much as large ones."""

    cut: Annotated[Literal["mask", "hull"], READING] = "hull"
    """What a crop shows. mask: the pixels of the mask, as in the paper. hull: those of its convex hull, so that the
    holes and ragged edges of the small SAM2's masks do not show. Answers keep the outlines of the masks. With
    published models the default is mask."""

    max_views: Count | None = None
    """Largest number of encoded views per instance, evenly spaced over its frames. null encodes all. Fewer take
    proportionally less time; the remaining frames then use the consistent feature alone."""

    @property
    def hull(self) -> bool:
        """Whether crops show the convex hulls of the masks."""
        return self.cut == "hull"


class FeaturesOptions(SeedOptions):
    """Aggregation of each instance's view features into one consistent feature, and compression to codes."""

    mad_norm: Annotated[Literal["element", "euclidean", "cosine", "none"], READING] = "element"
    """Distance of a view from the median of its instance's views (docs/method.md#deviation). element: each channel
    by itself. euclidean: length of the difference. cosine: 1 - cosine. none: no outlier test, a plain mean. With
    imperfect tracks element identifies most objects correctly (benchmarks/aggregation/README.md)."""

    mad_k: Annotated[float, Field(ge=1), READING] = 3.0
    """Outlier limit in units of the median absolute deviation. The paper uses 3. Lower rejects more views; higher
    keeps views of the wrong object. Values below 1 could reject all views and are not allowed."""

    normalize: Annotated[bool, READING] = True
    """Scale means and averages to unit norm (docs/method.md#unit-norm). Similarity to text depends on the direction
    alone. Without it, instances whose views disagree get less weight in the compression."""

    supervision: Literal["average", "consistent", "view"] = "average"
    """Training target of the Gaussians. average: mean of the view's feature and the consistent feature, as in the
    paper. consistent: the consistent feature alone. view: the view's feature alone, as in LangSplat, without
    aggregation."""

    outlier_target: Annotated[Literal["consistent", "average"], READING] = "consistent"
    """Target for outlier views if supervision is average (docs/method.md#supervision-average). consistent: the
    consistent feature alone. average: the mean of both, which keeps half of the outlier."""

    mismatched_views: Annotated[Literal["keep_own", "average"], READING] = "keep_own"
    """Target for views whose track has switched to another object, if supervision is average. keep_own: the view's
    own feature. average: the mean with the consistent feature, as in the paper. A view counts as mismatched if its
    cosine with the consistent feature is below the midpoint between 1 and the mean cosine between different
    instances. On five apartments keep_own found 3.3 points more queries, which may be chance
    (benchmarks/aggregation/README.md). With correct tracks hardly a view is affected."""

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
