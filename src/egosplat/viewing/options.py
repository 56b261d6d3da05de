"""Options of the scene page."""

from dataclasses import dataclass

from egosplat.query.options import QueryOptions


@dataclass(frozen=True)
class ScenePageOptions(QueryOptions):
    """The keys of ``scene_page`` and ``query``, and of OpenCLIP in ``models``; see ``config.schema.yaml``."""

    backend: str
    max_gaussians: int
    clip_model: str
    clip_checkpoint: str
    device: str
    precision: str
