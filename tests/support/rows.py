"""Rows of scored scenes, without the work that makes them."""

import numpy as np
import pandas as pd

from benchmarks.rows import COLUMNS, Rows

SCENES = ("ledger/busy1", "ledger/usual1")


def some_rows() -> Rows:
    """Two settings of two scenes; ``full`` finds more than ``other``, which was not asked for the last category. Of three carried
    things one is told rightly, one wrongly."""
    rng, listed = np.random.default_rng(0), {name: [] for name in COLUMNS}
    for setting, share in (("full", 0.7), ("other", 0.5)):
        for scene in SCENES:
            for number in range(12 if setting == "full" else 11):
                hit, iou = int(rng.random() < share), round(float(rng.random()), 3)
                for group in ("all", ("static", "dynamic")[number % 2]):
                    listed["queries"].append(
                        (scene, setting, group, number, f"thing {number}", hit, iou, 0.25, 0)
                    )
                absent = number % 3 == 0
                untaught = int(absent and number % 2 == 0)
                hit = int(hit and not untaught)
                right = None if absent else hit
                # What is right has more evidence of each kind.
                sure = float(bool(right)) + rng.normal(0, 0.5)
                graded = ("found" if hit else "not found", 0.5, sure - 5, sure, 0.1, sure)
                listed["presence"].append(
                    (scene, setting, f"thing {number}", int(not absent), 0.8, hit, untaught, right, *graded)
                )
            for frame in range(4):
                for group in ("all", "static"):
                    listed["frames"].append(
                        (scene, setting, group, frame, 100, 25.0 + frame + rng.random(), 0.9)
                    )
            listed["runs"].append((scene, setting, 321.0, 900.0, 1000, 0, "balanced", "c0de", "c0de", True))
    for number, (told, right) in enumerate(((1, 1), (1, 0), (0, 0))):
        listed["places"].append((SCENES[0], "full", f"Cup_{number}", "cup", 0.0, 5.0, told, right))
    tables = {
        name: pd.DataFrame(rows, columns=["scene", "setting", *COLUMNS[name]])
        for name, rows in listed.items()
    }
    about = {"name": "mine", "commits": ["c0de"], "machines": ["a processor, 2 cores"], "date": "2026-01-01"}
    return Rows(about, tables)
