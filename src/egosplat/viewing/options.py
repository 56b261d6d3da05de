"""Options of the stage ``scene_page``."""

from egosplat.pipeline.options import Count
from egosplat.pipeline.shared_options import BackendOptions, ClipOptions, DeviceOptions
from egosplat.query.options import QueryOptions


class ScenePageOptions(QueryOptions, ClipOptions, BackendOptions, DeviceOptions):
    """The page of a scene, scene.html."""

    max_gaussians: Count = 200000
    """Largest number of Gaussians on the page; of more, those that cover most are kept. 100,000 make a file of
    about 6 MB."""
