"""Times of the scene page in a real browser."""
