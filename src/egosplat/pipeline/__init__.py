"""Stages, configuration, scenes and variants, which the workflow reads. Imports neither torch nor Zarr."""
