"""Times of the scene page, in a headless Chromium without a GPU.

    python -m benchmarks.viewing results/adt/scene1

Needs Chromium and the package playwright.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import click

from benchmarks.common import command
from benchmarks.viewing import pages
from benchmarks.viewing.multiplied import multiply
from egosplat.artifacts import provenance
from egosplat.pipeline.config import defaults
from egosplat.pipeline.home import title_of

# Sizes of the page; the last is the default limit.
SIZES = (10_000, 50_000, defaults()["scene_page"]["max_gaussians"])

# Copies of each Gaussian in the scene of many: a million where a scene has 100,000.
COPIES = 10

WORDS = ("couch", "desk lamp", "carpet", "television", "window")


@command(__doc__)
@click.argument("scene", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(scene: Path) -> None:
    """Print the table."""
    with TemporaryDirectory() as work:
        folder = Path(work)
        rows = [pages.measured(scene, folder / f"{most}.html", most, WORDS) for most in SIZES]
        many = multiply(scene, folder / "results" / "many" / "scene", COPIES)
        rows.append(pages.measured(many, folder / "many.html", SIZES[-1], WORDS))
    click.echo(f"{title_of(scene)}, {provenance.machine()}\n\n{pages.table(rows)}")


if __name__ == "__main__":
    main()
