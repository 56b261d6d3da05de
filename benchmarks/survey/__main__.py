"""What a survey finds in synthetic apartments in which nothing moves, and in which people are at work.

    python -m benchmarks.survey SEED... [--folder FOLDER] [--fps 4] > benchmarks/survey/README.md

Films each apartment twice, with synthetic.motion 0 and 0.5, and lays out the evidence of both as a table. What is in
the folder already is not made again.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

KINDS = {"nothing": 0.0, "people": 0.5}


def main() -> None:
    """Film, survey and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seeds", nargs="+", type=int, help="apartments")
    parser.add_argument("--folder", type=Path, default=Path("results/benchmarks/survey"))
    parser.add_argument("--fps", type=float, default=4.0)
    parser.add_argument("--seconds", type=float, default=12.0)
    options = parser.parse_args()
    rows = []
    for seed in options.seeds:
        for kind, motion in KINDS.items():
            scene = options.folder / f"{seed}_{kind}_{options.fps:g}fps"
            filmed(scene, seed, motion, options.fps, options.seconds)
            egosplat(
                "survey",
                frames=scene / "frames.zarr",
                poses=scene / "poses.zarr",
                output=scene / "survey.json",
            )
            rows.append(row(seed, kind, json.loads((scene / "survey.json").read_text())))
    print(table(rows))


def filmed(scene: Path, seed: int, motion: float, fps: float, seconds: float) -> None:
    """frames.zarr and poses.zarr of an apartment."""
    if (scene / "poses.zarr").exists():
        return
    recording, frames = scene / "recording", scene / "frames.zarr"
    egosplat("synthetic", output=recording, seed=seed, size=352, fps=fps, seconds=seconds, motion=motion)
    egosplat("frames", recording=recording, format="adt", output=frames, resolution=256, evaluation_frames=8)
    egosplat("poses", recording=recording, frames=frames, output=scene / "poses.zarr")


def egosplat(stage: str, **flags: object) -> None:
    """Run a stage by its command."""
    words = [word for name, value in flags.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    subprocess.run([sys.executable, "-m", "egosplat.cli", stage, *words], check=True)


def row(seed: int, kind: str, survey: dict[str, Any]) -> str:
    """One scene's line of the table."""
    motion, views = survey["motion"], survey["views"]
    moving = [pair["moving"] for pair in motion["pairs"]]
    cells = [
        str(seed),
        kind,
        f"{motion['share']:.4%}",
        f"{sum(one > 0 for one in moving)} of {len(moving)}",
        f"{max(moving):.2%}",
        f"{motion['measured']:.0%}",
        motion["masking"],
        f"{len(views['left_out'])} of {survey['poses']['frames']}",
    ]
    return f"| {' | '.join(cells)} |"


def table(rows: list[str]) -> str:
    """As Markdown."""
    names = [
        "apartment",
        "moves",
        "share",
        "pairs with motion",
        "most in a pair",
        "measured",
        "masking",
        "left out",
    ]
    return "\n".join([f"| {' | '.join(names)} |", "| --- " * len(names) + "|", *rows])


if __name__ == "__main__":
    main()
