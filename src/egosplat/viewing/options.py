"""Options of the scene page."""

from egosplat.pipeline.options import Count
from egosplat.pipeline.shared_options import ClipOptions
from egosplat.query.options import AskingOptions


class PageOptions(AskingOptions):
    """The page of a scene, scene.html."""

    max_gaussians: Count = 200000
    """Largest number of Gaussians on the page; of more, those that cover most are kept. 100,000 make a file of
    about 6 MB."""


class ScenePageOptions(PageOptions, ClipOptions):
    """The page of a scene, scene.html."""
