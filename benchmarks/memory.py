"""Peak memory of every stage of some scenes, beside the law that jobs ask a cluster by (``egosplat.cluster.memory``).

    python benchmarks/memory.py results/adt/scene1 ... > benchmarks/memory.md

What is measured is what each artifact says of the process that made it.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import click

from egosplat.cluster.memory import peak_mb
from egosplat.cluster.shapes import Shapes
from egosplat.pipeline import config as configuration
from egosplat.pipeline.config import Config
from egosplat.progress import log

SIZES = ("frames", "pixels", "instances", "views", "gaussians")

HEAD = """# Peak memory

| scene | stage | frames | pixels | instances | views | Gaussians | measured [MB] | law [MB] | law / measured |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"""


def provenances(folder: Path) -> Iterator[dict]:
    """How each artifact of a scene, and its scores, were made."""
    for path in sorted(folder.glob("*.zarr")):
        yield json.loads((path / "zarr.json").read_text())["attributes"]["egosplat"]["provenance"]
    for path in folder.glob("metrics.json"):
        yield json.loads(path.read_text())["provenance"]


def config_of(made: list[dict]) -> Config:
    """The configuration that a scene was made with, as its artifacts have it."""
    config = configuration.defaults()
    for one in made:
        for section in (one["stage"], "query", "models"):
            known = configuration.section_keys(section)
            config[section] |= {key: value for key, value in one["options"].items() if key in known}
    return config


def told(shapes: Shapes, size: str) -> str:
    """A size of the scene; nothing where it is not made as far."""
    try:
        return f"{getattr(shapes, size):,}"
    except LookupError:
        return ""


def row(folder: Path, one: dict, config: Config) -> str:
    """A stage's row of the table."""
    shapes = Shapes(map(str, folder.glob("*.zarr")))
    measured, law = one["peak_memory_mb"], peak_mb(one["stage"], config, shapes)
    if measured > law:
        log(f"warning: {folder}: {one['stage']} needs more than the law says")
    numbers = " | ".join(told(shapes, size) for size in SIZES)
    return (
        f"| {'/'.join(folder.parts[-2:])} | {one['stage']} | {numbers} "
        f"| {measured:.0f} | {law:.0f} | {law / measured:.1f} |"
    )


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
def main(folders: tuple[Path, ...]) -> None:
    """Print the table of finished scenes, the FOLDERS."""
    print(HEAD)
    for folder in folders:
        made = list(provenances(folder))
        config = config_of(made)
        for one in made:
            print(row(folder, one, config))


if __name__ == "__main__":
    main()
