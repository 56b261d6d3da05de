"""Ray casting against triangles, with equal results on every processor."""
