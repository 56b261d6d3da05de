"""Options of the stage ``rests``."""

from egosplat.pipeline.shared_options import BackendOptions, ClipOptions, DeviceOptions, SeedOptions


class RestsOptions(ClipOptions, DeviceOptions, SeedOptions, BackendOptions):
    """Gaussians of things that lie somewhere for a while."""
