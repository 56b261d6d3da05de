"""Render the worlds that the small models are trained on.

    python -m training.render_worlds data/training --worlds 300
    python -m training.render_worlds data/held_out --worlds 20 --held-out --size 512 --frames 48 --clips 1

Existing worlds are kept, so the same command resumes an interrupted run.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from egosplat.progress import show_log, track
from training.small_models.worlds import HELD_OUT_SEEDS, TRAINING_SEEDS, ClipSettings, render_world


def main() -> None:
    """Parse the command line and render."""
    default = ClipSettings()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("output", type=Path, help="output folder; each world gets a folder")
    parser.add_argument("--worlds", type=int, required=True, help="number of worlds")
    parser.add_argument("--held-out", action="store_true", help="worlds for evaluation, with other seeds")
    parser.add_argument("--size", type=int, default=default.size, help="side of the images [px]")
    parser.add_argument("--clips", type=int, default=default.clips, help="clips per world")
    parser.add_argument("--frames", type=int, default=default.frames, help="frames per clip")
    parser.add_argument("--step", type=float, default=default.step_s, help="time between frames [s]")
    parser.add_argument("--homes", action="store_true", help="plain surfaces, and other light, as in homes")
    parser.add_argument("--processes", type=int, default=2, help="worlds rendered in parallel")
    args = parser.parse_args()
    settings = ClipSettings(args.size, args.clips, args.frames, args.step, args.homes)
    first = HELD_OUT_SEEDS if args.held_out else TRAINING_SEEDS
    seeds = [seed for seed in range(first, first + args.worlds) if not (args.output / str(seed)).exists()]
    folders = [args.output / str(seed) for seed in seeds]
    with ProcessPoolExecutor(args.processes) as pool:
        made = pool.map(render_world, seeds, [settings] * len(seeds), folders)
        for _ in track(made, "rendering worlds", total=len(seeds)):
            pass


if __name__ == "__main__":
    show_log()
    main()
