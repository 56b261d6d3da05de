"""Scripts that train the small checkpoints: ``python -m training.NAME``."""
