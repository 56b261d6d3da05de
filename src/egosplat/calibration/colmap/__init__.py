"""COLMAP through pycolmap, whose log is silenced: it has a line for every image and pair."""

import pycolmap

_FATAL_ONLY = 3
pycolmap.logging.minloglevel = _FATAL_ONLY
