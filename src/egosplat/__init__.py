"""egosplat: ask questions in words of a 3D scene filmed from someone's head."""

__version__ = "0.1.0"
