"""Options of the stage ``carries``."""

from egosplat.pipeline.shared_options import BackendOptions


class CarriesOptions(BackendOptions):
    """Things that are carried from place to place."""
