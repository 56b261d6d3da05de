"""Findings of a survey in synthetic apartments where nothing moves and where people work.

    python -m benchmarks.survey 1 2 3 4 5 11 12 > benchmarks/survey/README.md

Films each apartment (by its seed) twice, with `synthetic.motion` 0 and 0.5, and prints the evidence of both surveys. Existing
artifacts in `--folder` are used again.
"""

import json
from pathlib import Path
from typing import Any

import click

from benchmarks.common import command, markdown, output_of

KINDS = {"nothing": 0.0, "people": 0.5}


def film(scene: Path, seed: int, motion: float, fps: float, seconds: float) -> None:
    """Make frames.zarr and poses.zarr of an apartment."""
    if (scene / "poses.zarr").exists():
        return
    recording, frames = scene / "recording", scene / "frames.zarr"
    egosplat("synthetic", output=recording, seed=seed, size=352, fps=fps, seconds=seconds, motion=motion)
    egosplat("frames", recording=recording, format="adt", output=frames, resolution=256, evaluation_frames=8)
    egosplat("poses", recording=recording, frames=frames, output=scene / "poses.zarr")


def egosplat(stage: str, **flags: object) -> None:
    """Run a stage by its command."""
    words = [word for name, value in flags.items() for word in (f"--{name.replace('_', '-')}", value)]
    output_of("egosplat.cli", stage, *words)


def row(seed: int, kind: str, survey: dict[str, Any]) -> dict[str, object]:
    """A scene's cells by column."""
    motion, views = survey["motion"], survey["views"]
    moving = [pair["moving"] for pair in motion["pairs"]]
    return {
        "apartment": seed,
        "moves": kind,
        "masking": motion["masking"],
        "share": f"{motion['share']:.4%}",
        "pairs with motion": f"{sum(one > 0 for one in moving)} of {len(moving)}",
        "most in a pair": f"{max(moving):.2%}",
        "measured": f"{motion['measured']:.0%}",
        "left out": f"{len(views['left_out'])} of {survey['poses']['frames']}",
    }


@command(__doc__)
@click.argument("seeds", nargs=-1, required=True, type=int)
@click.option("--folder", default=Path("results/benchmarks/survey"), type=click.Path(path_type=Path))
@click.option("--fps", default=4.0, show_default=True)
@click.option("--seconds", default=12.0, show_default=True)
def main(seeds: tuple[int, ...], folder: Path, fps: float, seconds: float) -> None:
    """Film, survey and print the table."""
    rows = []
    for seed in seeds:
        for kind, motion in KINDS.items():
            scene = folder.resolve() / f"{seed}_{kind}_{fps:g}fps"
            film(scene, seed, motion, fps, seconds)
            survey = scene / "survey.json"
            egosplat("survey", frames=scene / "frames.zarr", poses=scene / "poses.zarr", output=survey)
            rows.append(row(seed, kind, json.loads(survey.read_text())))
    click.echo(markdown(list(rows[0]), [list(one.values()) for one in rows], words=3))


if __name__ == "__main__":
    main()
