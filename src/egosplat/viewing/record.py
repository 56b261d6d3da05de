"""What a scene page was made from."""

from collections.abc import Iterable

import egosplat
from egosplat.artifacts.reader import Artifact
from egosplat.query.options import QueryOptions
from egosplat.viewing.container import Facts
from egosplat.viewing.options import ScenePageOptions

# Keys that a page depends on. The others say where it is computed, and which OpenCLIP, which features.zarr tells.
_KEYS = (*QueryOptions.model_fields, "max_gaussians")


def record_of(artifacts: Iterable[Artifact], options: ScenePageOptions) -> Facts:
    """The version, the artifacts' digests and the options: pages with equal records show and answer the same."""
    values = options.as_dict()
    return {
        "version": egosplat.__version__,
        "made_from": {artifact.path.name: artifact.digest for artifact in artifacts},
        "options": {name: values[name] for name in _KEYS},
    }
