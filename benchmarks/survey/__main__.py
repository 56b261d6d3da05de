"""How well the survey tells what moves from what trembles, and what it finds of poses and exposure.

    python -m benchmarks.survey results/real_camera/* APARTMENTS --still results/real/fox --still results/tum/office

Reads the `survey.json` of scenes, or makes it where there is none. A scene moves unless it is named with `--still` or its name ends in
`still`. The limits are chosen on every second strength of real_camera, the tuning apartments and the fox. The others are validation.
"""

import json
from pathlib import Path
from typing import Any

import click

from benchmarks.common import command, markdown
from egosplat.evaluation.presence import separation
from egosplat.pipeline.home import title_of
from egosplat.pipeline.running import run_stage
from egosplat_rivals.scored_scenes import VALIDATION

# The order of strengths in benchmarks/real_camera: their seeds are consecutive.
_STRENGTHS = ("half", "once", "twice", "4times")


def survey_of(folder: Path) -> dict[str, Any]:
    """Read or make the survey of a scene."""
    path = folder / "survey.json"
    if not path.exists():
        run_stage("survey", frames=folder / "frames.zarr", poses=folder / "poses.zarr", output=path)
    return json.loads(path.read_text())


def is_tuning(folder: Path) -> bool:
    """Whether limits may be chosen on a scene: strengths once and 4times, tuning apartments, and the fox."""
    for place, strength in enumerate(_STRENGTHS):
        if f"_{strength}_" in folder.name:
            return place % 2 == 1
    return folder.name not in VALIDATION if folder.name.startswith("scene") else folder.name == "fox"


def row(name: str, moves: bool, survey: dict[str, Any]) -> list[object]:
    """A scene's cells."""
    motion, camera = survey["motion"], survey["camera"]
    regions = sum(pair["moving"] > 0 for pair in motion["pairs"])
    lasting = sum(pair["lasting"] > 0 for pair in motion["pairs"])
    known = motion["share"] is not None
    wrong = known and (motion["share"] >= 5e-4) != moves
    return [
        name,
        "yes" if moves else "no",
        f"{motion['share']:.3%}{' (wrong)' if wrong else ''}" if known else "cannot tell",
        f"{lasting} and {regions} of {len(motion['pairs'])}",
        f"{motion['voting']:.0%}",
        f"{camera['pose_residual_px']:.2f} / {camera['pose_noise_px']:.2f}",
        "on" if camera["refine_poses"] else "off",
        f"{camera['brightness_stops']:.2f}",
        "on" if camera["compensate_exposure"] else "off",
    ]


COLUMNS = [
    "scene",
    "moves",
    "share",
    "pairs, lasting and all",
    "voting",
    "pose residual / noise [px]",
] + ["refine poses", "exposure [stops]", "compensate"]


@command(__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--still", multiple=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...], still: tuple[Path, ...]) -> None:
    """Survey and print the tables."""
    rows, shares = [], []
    for folder in (*still, *folders):
        moves = folder not in still and not folder.name.endswith("still")
        survey = survey_of(folder)
        rows.append(row(title_of(folder), moves, survey))
        shares.append((is_tuning(folder), moves, survey["motion"]["share"] or 0.0))
    groups = {
        half: [
            [share for chosen, moves, share in shares if chosen == half and moves == kind]
            for kind in (False, True)
        ]
        for half in (True, False)
    }
    cells = [
        [name, len(groups[half][0]), len(groups[half][1]), f"{separation(*reversed(groups[half])):.3f}"]
        for name, half in (("tuning", True), ("validation", False))
    ]
    click.echo(markdown(["half", "still", "moving", "area under ROC"], cells) + "\n")
    click.echo(markdown(COLUMNS, rows))


if __name__ == "__main__":
    main()
