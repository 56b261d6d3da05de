"""Options of the stage ``language``."""

from typing import Annotated

from pydantic import Field

from egosplat.pipeline.options import Count, Positive, one_of
from egosplat.pipeline.shared_options import BackendOptions, MaskSourceOptions, SeedOptions
from egosplat.pipeline.stages import STAGES


class LanguageOptions(MaskSourceOptions, SeedOptions, BackendOptions):
    """Codes of each Gaussian at each level."""

    method: Annotated[str, one_of(name for name in STAGES["language"].modules if name != "joint")] = "lifted"
    """How Gaussians with fixed geometry get codes. lifted: each takes the code of the instance that it shows most,
    in one pass over the views (docs/method.md#lifting). trained: by gradient descent, as in LangSplat. docs/methods.md
    describes the other methods. No effect if splats.language is joint."""

    iterations: Count = 3000
    """Training iterations, one view each, if method trains. LangSplat, GAGS, LERF and LEGaussians use 30,000,
    LangSplatV2 10,000 for each of three levels; here an iteration of sparse trains one level."""

    lr: Positive = 0.0025
    """Adam learning rate if method is trained or sparse. LangSplat and LangSplatV2 use 0.0025. Codes start at 0, normalized ones as short random vectors."""

    pixels: Annotated[int, Field(ge=2)] = 8192
    """Pixels of a view that an iteration trains on, if method is sparse, granular, field or quantized. LERF uses
    4,096 of all views, the others all of a view. Fewer are faster and noisier; the expected loss is the same."""
