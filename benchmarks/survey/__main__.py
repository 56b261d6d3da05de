"""How well the survey tells what moves from what trembles, and what it finds of poses and exposure.

    python -m benchmarks.survey results/real_camera/* APARTMENTS --still results/real/fox --still results/tum/office

Reads the `survey.json` of scenes, or makes it where there is none. A scene moves unless it is named with `--still` or its name ends in
`still`. The probability is fitted to every second strength of real_camera, the tuning apartments and the fox. The others are reported
validation.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.common import command, markdown
from egosplat.evaluation.presence import separation
from egosplat.evaluation.scored_scenes import VALIDATION
from egosplat.pipeline.running import run_stage
from egosplat.pipeline.scene_folder import title_of
from egosplat.survey.decisions import LEAST_SHARE

# The order of strengths in benchmarks/real_camera: their seeds are consecutive.
_STRENGTHS = ("half", "once", "twice", "4times")


def survey_of(folder: Path) -> dict[str, Any]:
    """Read or make the survey of a scene."""
    path = folder / "survey.json"
    if not path.exists():
        run_stage("survey", frames=folder / "frames.zarr", poses=folder / "poses.zarr", output=path)
    return json.loads(path.read_text())


def is_tuning(folder: Path) -> bool:
    """Whether the probability may be fitted to a scene: strengths once and 4times, tuning apartments, and the fox."""
    for place, strength in enumerate(_STRENGTHS):
        if f"_{strength}_" in folder.name:
            return place % 2 == 1
    return folder.name not in VALIDATION if folder.name.startswith("scene") else folder.name == "fox"


def fit_probability(still: Sequence[float], moving: Sequence[float]) -> tuple[float, float]:
    """Share at which moving is as probable as still, and the power of the odds, by logistic regression.

    Labels are softened as by Platt (1999), because the groups do not overlap.
    """
    shares = np.maximum(np.concatenate([still, moving]), LEAST_SHARE)
    place = np.stack([np.ones_like(shares), np.log(shares) - np.log(shares).mean()], axis=1)
    count = len(still), len(moving)
    wanted = np.repeat([1 / (count[0] + 2), (count[1] + 1) / (count[1] + 2)], count)
    found = np.zeros(2)
    for _ in range(100):
        expected = 1 / (1 + np.exp(-place @ found))
        spread = place.T * (expected * (1 - expected))
        found += np.linalg.solve(spread @ place + 1e-9 * np.eye(2), place.T @ (wanted - expected))
    return float(np.exp(np.log(shares).mean() - found[0] / found[1])), float(found[1])


def row(name: str, moves: bool, survey: dict[str, Any]) -> list[object]:
    """A scene's cells."""
    motion, camera = survey["motion"], survey["camera"]
    regions = sum(pair["moving"] > 0 for pair in motion["pairs"])
    lasting = sum(pair["lasting"] > 0 for pair in motion["pairs"])
    known = motion["probability"] is not None
    right = known and motion["static"] != moves
    return [
        name,
        "yes" if moves else "no",
        f"{motion['probability']:.0%}{'' if right else ' (wrong)'}" if known else "cannot tell",
        f"{motion['share']:.3%}" if known else "",
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
    "probability",
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
    even, power = fit_probability(*groups[True])
    click.echo(f"Fitted to the tuning half: even share {even:.2g}, power {power:.2g}\n")
    cells = [
        [name, len(groups[half][0]), len(groups[half][1]), f"{separation(*reversed(groups[half])):.3f}"]
        for name, half in (("tuning", True), ("validation", False))
    ]
    click.echo(markdown(["half", "still", "moving", "area under ROC"], cells) + "\n")
    click.echo(markdown(COLUMNS, rows))


if __name__ == "__main__":
    main()
