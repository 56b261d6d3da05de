"""Segment frames at three levels (subpart, part, whole) and track the instances through the video."""
