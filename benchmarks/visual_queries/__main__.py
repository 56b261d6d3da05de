"""Ego4D's visual queries in 3D, on finished synthetic scenes: crops of things from one half of a recording, asked in the other.

    python -m benchmarks.visual_queries results/adt/scene1 --elsewhere results/adt/scene2 [--earlier results/adt/scene1_walk1]

As in VQ3D, an answer succeeds within 6 exp(-d) m of the middle of the thing's box, d its diagonal [m]; the angle is between
displacements from the camera of the crop's frame. ``--elsewhere`` has crops of things that are not in the scene, ``--earlier`` of
another recording of the same apartment (synthetic.walk), which are asked in the whole scene.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from benchmarks.carries.truth import read_boxes, recording_of
from benchmarks.common import command, markdown
from benchmarks.transient.truth import Truth, read_truth
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES
from egosplat.geometry import invert, transform
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import FOUND, GUESS, NOT_FOUND
from egosplat.query.like import SIMILARITY, Alike, Looks, see

# Pixels of a thing in a frame from which it is cut out; crops of a thing in each half.
LEAST_PIXELS, CROPS = 150, 3

FOLDER = click.Path(exists=True, path_type=Path)
ROWS = Path(__file__).with_name("rows.csv")


def read_crops(folder: Path) -> Iterator[tuple[str, int, np.ndarray]]:
    """Name, frame and crop of each thing that stays, in frames that show more of it, and of half of the recording each."""
    frames, truth = _frames_and_truth(folder)
    labels = np.stack([*truth.all_labels()])
    for number, name in enumerate(truth.names):
        for half in np.array_split(np.arange(len(labels)), 2):
            pixels = (labels[half] == number).sum(axis=(1, 2))
            shown = half[np.argsort(-pixels, kind="stable")][: int((pixels >= LEAST_PIXELS).sum())]
            # What fills the view is the room.
            if truth.moves[number] or not len(shown) or pixels.max() > labels[0].size / 3:
                continue
            for frame in shown[np.unique(np.linspace(0, len(shown) - 1, CROPS).astype(int))].tolist():
                y, x = np.nonzero(labels[frame] == number)
                yield name, frame, frames.row("rgb", frame)[y.min() : y.max() + 1, x.min() : x.max() + 1]


def _frames_and_truth(folder: Path) -> tuple[Artifact, Truth]:
    frames = open_artifact(folder / "frames.zarr", FRAMES)
    return frames, read_truth(recording_of(folder), frames)


def ask(folder: Path, earlier: Path | None = None) -> Iterator[dict[str, Any]]:
    """A row for each crop of a scene, asked in the half of its recording that it is not of; or of an ``earlier`` scene of the place."""
    scene, boxes = open_scene(folder), read_boxes(recording_of(folder))
    poses, truth = (open_scene(earlier) if earlier else scene).poses, _frames_and_truth(folder)[1]
    moving = {name for name, moves in zip(truth.names, truth.moves, strict=True) if moves}
    middle = len(scene.frames) / 2
    for name, frame, crop in (one for one in read_crops(earlier or folder) if one[0] not in moving):
        looks = Looks(scene)
        chosen = (looks.frame >= middle) != (frame >= middle) if earlier is None else slice(None)
        for views in ("instance", "frame", "box", "feature"):
            setattr(looks, views, getattr(looks, views)[chosen])
        row = _judged(looks.find(see(scene.clip, crop), 2, pictured=True)) | {"thing": name, "frame": frame}
        center, diagonal = boxes[name]
        told, true = transform(invert(poses[frame]), np.array([row.pop("center"), center]))
        angle = np.degrees(np.arccos(told @ true / np.linalg.norm(told) / np.linalg.norm(true)))
        yield row | {"angle": angle, "l2": np.linalg.norm(told - true), "limit": 6 * np.exp(-diagonal)}


def _judged(things: list[Alike]) -> dict[str, Any]:
    best, *others = things
    lead, grade = best.score - others[0].score if others else 1.0, SIMILARITY.grade(best.score)
    return {"grade": grade, "similarity": best.score, "lead": lead, "center": best.center}


def table(rows: pd.DataFrame) -> str:
    """VQ3D's scores of the crops whose thing is there, by the grades that are told, and the share of the others that are told, too."""
    here, away, lines = rows[rows["thing"] != "-"], rows[rows["thing"] == "-"], []
    for told in ([FOUND, GUESS, NOT_FOUND], [FOUND, GUESS], [FOUND]):
        own = here[here["grade"].isin(told) & here["l2"].notna()]
        success = own["l2"] < own["limit"]
        shares = [success.sum() / len(here), success.mean(), (own["l2"] < 0.5).mean(), len(own) / len(here)]
        shares.append(away["grade"].isin(told).mean())
        medians = f"{own['l2'].median():.2f}", f"{own['angle'].median():.0f}"
        lines.append((", ".join(told), *(f"{100 * share:.0f}" for share in shares), *medians))
    columns = "answers,success %,success* %,within 0.5 m %,QwP %,elsewhere told %,L2 [m],angle [deg]"
    return markdown(columns.split(","), lines)


@command(__doc__)
@click.argument("folder", type=FOLDER)
@click.option("--elsewhere", required=True, type=FOLDER, help="A scene without its things.")
@click.option("--earlier", type=FOLDER, help="Another recording of its apartment.")
def main(folder: Path, elsewhere: Path, earlier: Path | None) -> None:
    rows, looks = [*ask(folder, earlier)], Looks(open_scene(folder))
    for _, frame, crop in read_crops(elsewhere):
        judged = _judged(looks.find(see(looks.scene.clip, crop), 2, pictured=True))
        rows.append(judged | {"thing": "-", "frame": frame})
    found = pd.DataFrame(rows).drop(columns="center").round(3)
    found.to_csv(ROWS, index=False)
    click.echo(f"{(found['thing'] != '-').sum()} crops.\n\n{table(found)}")


if __name__ == "__main__":
    main()
