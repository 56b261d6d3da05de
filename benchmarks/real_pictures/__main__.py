"""Scenes of real recordings, asked for things that are there and for things that are not.

    python -m benchmarks.real_pictures results/real/fox results/real/desk --rows NEW.csv

Each scene has the name of its recording in boxes.tsv. Prints a row for each; without folders, the committed rows are taken.
Words are graded by a fit on the other recordings; ``--fit`` writes the fit on all.
"""

from collections.abc import Iterator
from dataclasses import asdict
from itertools import repeat
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from benchmarks.common import command, markdown
from benchmarks.presence.fit import at_share, held_out
from benchmarks.real_pictures.boxes import HERE, SAME, are_there, best_instance, read_boxes
from benchmarks.rows import EVIDENCE
from egosplat.query.calibrate import write_fit
from egosplat.query.finished_scene import Scene, open_scene
from egosplat.query.grades import FITS, FOUND, GUESS, LEAST_FOUND, LEAST_GUESS, judge
from egosplat.query.like import SIMILARITY, Looks, see
from egosplat.query.options import AskingOptions

ROWS = HERE / "rows.csv"

# The evidence that helps in recordings that a fit has not seen; with the level, log loss grows from 0.49 to 0.60.
SCORE = "fit"

# How a thing is asked for.
WORD, EXAMPLE, NAME = "word", "example", "name"


def measure(folder: Path) -> Iterator[dict[str, Any]]:
    """The rows of a scene: what was made of it, its boxes, and its answers."""
    scene, boxes = open_scene(folder), read_boxes(folder.name)
    yield {"kind": "scene", **facts_of(scene)}
    boxes["train"] = scene.artifact("frames").read("train")[boxes["frame"]]
    fits = [best_instance(scene, row["frame"], row["box"]) for row in boxes.to_dict("records")]
    boxes["iou"], boxes["instance"] = zip(*fits, strict=True)
    for row in boxes[boxes["train"]].to_dict("records"):
        yield {"kind": "box", "name": row["name"], "frame": row["frame"], "iou": row["iou"]}
    questions = pd.read_csv(HERE / "questions.tsv", sep="\t", keep_default_na=False)
    questions = questions[questions["recording"] == folder.name]
    words = scene.answers(questions["phrase"], most=1)
    asked = [*zip(words, repeat(WORD), questions["name"], strict=False)]
    looks = Looks(scene)
    for name, own in boxes.groupby("name"):
        # Nothing of the scene was made from these.
        shown = [see(scene.clip, crop(scene, row)) for row in own[~own["train"]].to_dict("records")[:2]]
        taught = own[own["iou"] >= SAME].nlargest(1, "iou")["instance"].tolist()
        for kind, every in ((EXAMPLE, shown), (NAME, [looks.thing(number)[1] for number in taught])):
            for wanted in every:
                things = looks.find(wanted, 2, kind == EXAMPLE)
                asked.append((judge(str(name), things, ((), None), SIMILARITY, 1), kind, name))
    judged = are_there(scene, [answer for answer, _, _ in asked], boxes, [name for _, _, name in asked])
    for (answer, kind, name), right in zip(asked, judged, strict=True):
        evidence = answer.candidates[0].evidence if answer.candidates else None
        about = {"kind": kind, "phrase": answer.phrase, "name": name, "grade": answer.grade}
        yield about | {"score": answer.rating, "right": right} | (asdict(evidence) if evidence else {})


def crop(scene: Scene, row: dict[str, Any]) -> np.ndarray:
    """The pixels of a frame in a box."""
    picture = scene.frames[row["frame"]]
    height, width = picture.shape[:2]
    left, top, right, bottom = (side / 100 for side in row["box"])
    return picture[int(top * height) : int(bottom * height), int(left * width) : int(right * width)]


def facts_of(scene: Scene) -> dict[str, Any]:
    """Frames, those with a pose, mean PSNR of the held-out frames [dB], processor time of all stages [s], and the OpenCLIP."""
    posed, psnr = np.isfinite(scene.poses).all(axis=(1, 2)), scene.artifact("splats").read("held_out/psnr")
    made = {one.path: one.provenance["cpu_s"] for one in scene.made_from.found.values()}
    clip, seconds = scene.encoded.facts["clip"]["hash"], sum(made.values())
    return {"phrase": clip, "frames": len(posed), "posed": posed.sum(), "psnr": psnr.mean(), "cpu_s": seconds}


def graded(rows: pd.DataFrame, share: float) -> pd.DataFrame:
    """The rows with ``present`` and ``true`` as numbers, and words graded by a fit on the other recordings, for a reader of whose words
    this share is there."""
    rows = rows.assign(present=rows["name"].ne("") * 1, true=rows["right"].eq(True) * 1.0)
    asked = rows[rows["kind"].eq(WORD) & rows["lead"].notna()]
    # What was made of one recording in several ways is left out together.
    asked = asked.assign(scene=asked["scene"].str.split().str[0])
    probability, _ = at_share(held_out(asked, [SCORE]), asked, share)
    grades = np.select([probability >= LEAST_FOUND, probability >= LEAST_GUESS], [FOUND, GUESS], "not found")
    return rows.assign(grade=rows["grade"].mask(rows.index.isin(asked.index), pd.Series(grades, asked.index)))


def table(rows: pd.DataFrame) -> str:
    """A row for each scene, and one for all."""
    columns = "recording;with a pose;boxes with an instance;words: place, found, guessed, wrong;absent: found, guessed;"
    columns += "examples;taught names;PSNR;CPU-s"
    groups = [*rows.groupby("scene", sort=False), ("all", rows)]
    return markdown(columns.split(";"), [_cells(str(name), own) for name, own in groups])


def _cells(name: str, rows: pd.DataFrame) -> list[str]:
    told, right = rows["grade"].isin([FOUND, GUESS]), rows["true"].eq(1)
    found, guessed = (rows["grade"].eq(grade) for grade in (FOUND, GUESS))
    box, word, example, taught = map(rows["kind"].eq, ("box", WORD, EXAMPLE, NAME))
    there, absent = word & rows["present"].eq(1), word & rows["present"].eq(0)
    answers = [right, right & found, right & guessed, told & ~right]
    counted = [(box, [rows["iou"] >= SAME]), (there, answers), (absent, [found, guessed])]
    counted += [(own, [right & told]) for own in (example, taught)]
    cells = [",".join(f"{(own & one).sum()}" for one in those) + f"/{own.sum()}" for own, those in counted]
    posed, frames, cpu_s = rows[["posed", "frames", "cpu_s"]].sum()
    return [name, f"{posed:.0f}/{frames:.0f}", *cells, f"{rows['psnr'].mean():.1f}", f"{cpu_s:.0f}"]


@command(__doc__)
@click.argument("folders", nargs=-1, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--rows", type=click.Path(path_type=Path), help="File for the rows.")
@click.option("--fit", is_flag=True, help=f"Write the fit into {FITS.name}.")
def main(folders: tuple[Path, ...], rows: Path | None, fit: bool) -> None:
    """Print the table."""
    measured = [{"scene": folder.name, **row} for folder in folders for row in measure(folder)]
    found = pd.DataFrame(measured) if folders else pd.read_csv(ROWS)
    found["name"] = found["name"].fillna("")
    if rows:
        found.to_csv(rows, index=False, float_format="%.4f")
    options = AskingOptions().suit("photos")
    found = graded(found, options.present_share)
    click.echo(table(found))
    if fit:
        asked = found[found["kind"].eq(WORD) & found["lead"].notna()]
        about = found["phrase"].iloc[0], options, " ".join(f"real/{name}" for name in asked["scene"].unique())
        evidence = asked[[*EVIDENCE]].mul([float(one == SCORE) for one in EVIDENCE])
        write_fit(FITS, about, *(one.to_numpy(float) for one in (evidence, asked["true"], asked["present"])))


if __name__ == "__main__":
    main()
