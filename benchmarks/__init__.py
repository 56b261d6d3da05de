"""Measurements of egosplat: ``python -m benchmarks.TOPIC``. Each topic's README.md has its results."""
