"""A viewer of finished scenes in the browser: ``egosplat view``."""
