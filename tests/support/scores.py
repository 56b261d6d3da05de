"""Scores as they stand in metrics.json."""

OPTIONS = {
    "hit_region": "box",
    "min_area": 0.001,
    "excluded": ["shelter"],
    "people": False,
}
"""Keys of the section metrics that scores in one table must share."""
