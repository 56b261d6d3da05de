"""Times of the scene page and of the viewer in a real browser."""
