"""Scores as they stand in metrics.json."""

OPTIONS = {
    "min_area": 0.001,
    "excluded": ["shelter"],
    "masks": "threshold",
}
"""Keys of the section metrics that scores in one table must share."""

SETUP = {
    "recording": {
        "kind": "adt",
        "name": "recording",
        "hash": "d",
        "frames": 3,
        "seconds": 1.0,
        "seed": 1,
        "camera": "ideal",
    }
} | {"seed": 0, "preset": "balanced", "commit": "c0de", "clean": True}
"""What was measured, and how."""
