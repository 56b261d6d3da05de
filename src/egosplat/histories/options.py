"""Options of the stage ``histories``."""

from egosplat.pipeline.shared_options import BackendOptions, ClipOptions, DeviceOptions, SeedOptions


class HistoriesOptions(ClipOptions, DeviceOptions, SeedOptions, BackendOptions):
    """What is carried, and Gaussians of what lies somewhere for a while."""
