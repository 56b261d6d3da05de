"""Rays cast at triangles, with equal results on every processor."""
