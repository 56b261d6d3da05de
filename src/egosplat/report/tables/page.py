"""Write all tables on one self-contained HTML page."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import ScoredScene
from egosplat.frames.images import read_rgb
from egosplat.images import LARGEST, encode_webp, shrink_image
from egosplat.report.tables.formats import COMMAND, render
from egosplat.report.tables.series import Series
from egosplat.report.tables.table import Table

_KINDS = (".png", ".jpg", ".jpeg")

# Quality of WebP on the page: a page of stage methods_sheet takes a sixth of its PNG, and its text stays sharp.
_QUALITY = 90


@dataclass(frozen=True)
class Picture:
    """An image of a scene.

    Attributes:
        address: content of the image, as a data URI.
    """

    name: str
    address: str


@dataclass(frozen=True)
class Source:
    """The scores of a scene, and the series that they belong to."""

    series: Series
    scene: ScoredScene


def read_picture(path: Path) -> Picture:
    """Read a PNG or JPEG file and encode it as WebP; its name is its path, relative to a folder ``results``.

    Raises:
        UserError: it cannot be read, or is of another kind.
    """
    if path.suffix.lower() not in _KINDS:
        raise UserError(f"{path}: is not an image for the page; give {', '.join(_KINDS)}")
    if not path.is_file():
        raise UserError(f"{path}: does not exist. Make it: snakemake --cores 2 {path}")
    try:
        image = read_rgb(path)
    except UserError as error:
        raise UserError(f"{error} Delete it and make it again: snakemake --cores 2 {path}") from error
    # Inside the page, so that it can be sent as one file.
    content = base64.b64encode(encode_webp(shrink_image(image, LARGEST), _QUALITY)).decode("ascii")
    return Picture(path.as_posix().rpartition("results/")[2], f"data:image/webp;base64,{content}")


def to_html(
    tables: Sequence[Table], series: Sequence[Series], pictures: Sequence[Picture], confidence: float | None
) -> str:
    """Write the page.

    Args:
        confidence: confidence of the intervals, such as 0.95; None without intervals.
    """
    return render(
        "tables.html.j2",
        tables=tables,
        generator=COMMAND,
        sources=[Source(one, scene) for one in series for scene in one.scenes.values()],
        alarmed=[scene for one in series for scene in one.scenes.values() if scene.document["alarms"]],
        pictures=pictures,
        confidence=None if confidence is None else f"{100 * confidence:g} %",
        measured_on=sorted({one.about for one in series}),
    )
