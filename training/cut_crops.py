"""Cut crops of objects, parts and subparts out of rendered worlds, for training a small OpenCLIP.

    python -m training.cut_crops data/training data/crops --worlds 240

Existing crop files are kept, so the same command resumes an interrupted run.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from egosplat.progress import show_log, track
from training.small_models.crops import cut_world
from training.small_models.segmented import segment_images


def main() -> None:
    """Parse the command line and cut."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("input", type=Path, help="folder of rendered worlds")
    parser.add_argument("output", type=Path, help="folder of the crops, one file a world")
    parser.add_argument("--worlds", type=int, required=True, help="how many, from the first seed on")
    parser.add_argument(
        "--segments", action="store_true", help="also crops of the masks that the small SAM2 finds"
    )
    parser.add_argument("--processes", type=int, default=2, help="worlds cut at a time")
    args = parser.parse_args()
    folders = sorted(folder for folder in args.input.iterdir() if folder.name.isdigit())[: args.worlds]
    outputs = [args.output / f"{folder.name}.npz" for folder in folders]
    wanted = [pair for pair in zip(folders, outputs, strict=True) if not pair[1].exists()]
    with ProcessPoolExecutor(args.processes) as pool:
        cut = partial(cut_world, segment=segment_images if args.segments else None)
        made = pool.map(cut, *zip(*wanted, strict=True)) if wanted else []
        for _ in track(made, "cutting crops", total=len(wanted), unit="world"):
            pass


if __name__ == "__main__":
    show_log()
    main()
