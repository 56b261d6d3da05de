"""Train the small OpenCLIP that is bundled with egosplat.

    python -m training.open_clip data/crops models/small_open_clip --steps 4000

The same command resumes an interrupted run from ``state.pt`` in the model's folder.
"""

import argparse
from pathlib import Path

import torch
from safetensors.torch import load_file

from egosplat.progress import log, show_log
from training.small_models.captions import unseen_combination
from training.small_models.clip_model import WEIGHTS, build, save_weights, write_description
from training.small_models.clip_training import Schedule, Trainer
from training.small_models.crops import read_crops


def main() -> None:
    """Parse the command line and train."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("crops", type=Path, help="folder of crops")
    parser.add_argument("output", type=Path, help="folder of the model")
    parser.add_argument("--steps", type=int, required=True, help="number of steps")
    parser.add_argument("--until", type=int, help="stop at this step (default: the last)")
    parser.add_argument(
        "--worlds", type=int, help="number of worlds to use, from the first seed on (default: all)"
    )
    parser.add_argument(
        "--start", type=Path, help="folder of a model to start from (default: random weights)"
    )
    default = Schedule(steps=0)
    parser.add_argument("--rate", type=float, default=default.learning_rate, help="largest learning rate")
    parser.add_argument(
        "--squares", type=float, default=default.squares, help="fraction of crops shown as unmasked squares"
    )
    parser.add_argument("--tiles", type=float, default=default.tiles, help="fraction of crops that are tiles")
    parser.add_argument(
        "--segments", type=float, default=default.segments, help="fraction of crops that are masks of SAM2"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of weights, samples and augmentation")
    parser.add_argument("--device", default="cpu", help="device to train on")
    parser.add_argument("--threads", type=int, default=1, help="CPU threads")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    crops = read_crops(sorted(args.crops.glob("*.npz"))[: args.worlds])
    crops = crops.chosen(~unseen_combination(crops))
    log(f"{len(crops)} crops")
    write_description(args.output)
    model, tokenizer = build(args.output)
    state = args.output / "state.pt"
    if args.start:
        model.load_state_dict(load_file(args.start / WEIGHTS))
    shares = {"squares": args.squares, "tiles": args.tiles, "segments": args.segments}
    schedule = Schedule(args.steps, learning_rate=args.rate, **shares)
    trainer = Trainer(model, tokenizer, crops, schedule, args.seed, args.device)
    trainer.run(state, args.until or args.steps)
    if trainer.step == args.steps:
        save_weights(model, args.output / WEIGHTS)
        state.unlink()


if __name__ == "__main__":
    show_log()
    main()
