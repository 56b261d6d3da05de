"""Logarithmic axes of pictures, with plain numbers."""

from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter


def plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis; matplotlib's own labels are formulas, which pictures with names in them do not read."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
