"""matplotlib as all pictures take it: without a screen, and with names as they are written."""

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams["text.parse_math"] = False  # a name may hold dollars

from matplotlib import pyplot as plt

__all__ = ["plt"]
