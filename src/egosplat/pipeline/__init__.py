"""The pipeline as data: its stages. The workflow asks it; it imports neither torch nor Zarr."""
