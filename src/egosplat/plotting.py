"""matplotlib as all pictures take it: without a screen, and with names as they are written."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams["text.parse_math"] = False  # a name may hold dollars

from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from egosplat.output_files import SOFTWARE, FileKind, output_file
from egosplat.page_text import arrange_texts

__all__ = ["plt", "save_picture"]

DPI = 90


def save_picture(figure: Figure, output: Path, kind: FileKind) -> None:
    """Write a figure as PNG, marked with the command that made it, and close it; the file is whole or absent.

    Titles that are too long are wrapped first, and names moved into their pictures.

    Raises:
        UserError: something is at ``output`` that the command did not write.
    """
    arrange_texts(figure)
    with output_file(output, kind) as scratch:
        figure.savefig(scratch, dpi=DPI, format="png", metadata={SOFTWARE: kind.command})
    plt.close(figure)
