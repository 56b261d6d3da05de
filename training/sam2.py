"""Train the small SAM2 on rendered worlds.

    python -m training.render_worlds data/training --worlds 300
    python -m training.sam2 data/training --output src/egosplat/models/small_sam2 --state data/sam2.pt

The same command goes on where it was stopped. First single pictures with point prompts, then, in turns with
them, clips in which masks are followed by memory.
"""

import argparse
import random
import signal
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
from safetensors.torch import save_file
from sam2.modeling.sam2_base import SAM2Base

from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.models.checkpoints import SAM2
from egosplat.models.sam2_loader import set_image_size
from egosplat.models.weights import load_weights, read_tensors
from egosplat.progress import log
from training.small_models.sam2_data import sample_clip, sample_prompts, sample_tracks, vocabulary
from training.small_models.sam2_losses import Guides
from training.small_models.sam2_steps import Outcome, clip_step, picture_step
from training.small_models.schedule import Average, half_precision, learning_rate, read_state, save_state
from training.small_models.worlds import FilmedWorld, read_world

CONFIG = Path(__file__).parents[1] / "src/egosplat/models/small_sam2/sam2.yaml"


@dataclass(frozen=True)
class Recipe:
    """What a run does; with the worlds and the seed it determines the result.

    Attributes:
        steps: in all; clips_from: share of them after which every other one is on clips.
        sides: of the pictures, each as often [px]: the model is to be of use at all of them.
        pictures, points: of a picture step; clips, frames, tracks: of a clip step. Pictures and clips at the first
            side; at another, as many as take as long.
        peak_rate, warm_up, decay: see ``learning_rate``; average: see ``Average``.
        still: share of the clip steps over which clips of one drifting picture give way to filmed ones, at the
            beginning; a third of all stay.
        place_scale: of the frequencies in which places are told to the decoder, as multiples of SAM2's.
        balance: see ``mask_loss``, at first; it is gone after ``balanced_steps`` of either kind.
    """

    steps: int
    seed: int
    clips_from: float = 0.6
    sides: tuple[int, ...] = (256, 384)
    pictures: int = 6
    points: int = 12
    clips: int = 2
    frames: int = 4
    tracks: int = 4
    peak_rate: float = 1.2e-3
    warm_up: int = 200
    decay: float = 0.3
    weight_decay: float = 0.03
    average: float = 0.9985
    still: float = 0.25
    place_scale: float = 2.0
    balance: float = 0.5
    balanced_steps: int = 2000


def main() -> None:
    """Parse the command line and train."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("worlds", type=Path, help="folder that render_worlds.py made")
    parser.add_argument("--output", type=Path, required=True, help="folder for model.safetensors")
    parser.add_argument("--state", type=Path, required=True, help="file from which a stopped run goes on")
    parser.add_argument(
        "--start", type=Path, help="weights to begin with (.safetensors), instead of random ones"
    )
    parser.add_argument("--steps", type=int, default=16_000, help="steps in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=2, help="of the CPU")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    worlds = [read_world(folder) for folder in sorted(args.worlds.glob("[0-9]*"))]
    if not worlds:
        raise SystemExit(
            f"{args.worlds}: holds no worlds; run python -m training.render_worlds {args.worlds}"
        )
    log(f"{len(worlds)} worlds, {args.steps} steps")
    try:
        run = Run(recipe_of(args), worlds, args.state, torch.device(args.device), args.start)
    except UserError as error:
        raise SystemExit(str(error)) from error
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, run.stop)
    run.train()
    if run.stopped:
        raise SystemExit(f"stopped at step {run.step}; the same command goes on from there")
    args.output.mkdir(parents=True, exist_ok=True)
    with atomic_file(args.output / "model.safetensors") as scratch:
        save_file(half_precision(run.average.weights), scratch)
    log(f"{args.output / 'model.safetensors'} written")


def recipe_of(args: argparse.Namespace) -> Recipe:
    """What the command line asks for; weights that are not random move more slowly, and know that masks are small."""
    if args.start is None:
        return Recipe(args.steps, args.seed)
    return Recipe(args.steps, args.seed, peak_rate=8e-4, balance=0.0)


class Run:
    """A training run: model, optimizer, averaged weights and the step it has come to."""

    def __init__(
        self,
        recipe: Recipe,
        worlds: list[FilmedWorld],
        state: Path,
        device: torch.device,
        start: Path | None = None,
    ) -> None:
        random.seed(recipe.seed)
        torch.manual_seed(recipe.seed)
        self.recipe, self.worlds, self.state_path = recipe, worlds, state
        self.step, self.stopped = 0, False
        self.model: SAM2Base = instantiate(OmegaConf.load(CONFIG).model, _recursive_=True).to(device).train()
        self.model.sam_prompt_encoder.pe_layer.positional_encoding_gaussian_matrix.mul_(recipe.place_scale)
        if start is not None:
            load_weights(self.model, read_tensors(start), start, SAM2)
        self.words = vocabulary(worlds)
        self.guides = Guides(self.model.hidden_dim, len(self.words)).to(device)
        self.optimizers = self._optimizers()
        self.average = Average(self.model, recipe.average)
        self.history: dict[str, deque[Any]] = {"pictures": deque(maxlen=100), "clips": deque(maxlen=100)}
        saved = read_state(state, device)
        if saved is not None:
            self._restore(saved)

    def _optimizers(self) -> list[torch.optim.Optimizer]:
        """Muon for the matrices of linear layers, AdamW for the rest; Muon's rate is scaled to AdamW's."""
        recipe = self.recipe
        matrices = {
            id(layer.weight)
            for model in (self.model, self.guides)
            for layer in model.modules()
            if isinstance(layer, torch.nn.Linear)
        }
        every = [*self.model.parameters(), *self.guides.parameters()]
        muon = [value for value in every if id(value) in matrices]
        adam = [value for value in every if id(value) not in matrices]
        options = {"lr": recipe.peak_rate, "weight_decay": recipe.weight_decay}
        return [
            torch.optim.Muon(muon, **options, adjust_lr_fn="match_rms_adamw"),
            torch.optim.AdamW(adam, **options, betas=(0.9, 0.98)),
        ]

    def _restore(self, saved: dict[str, Any]) -> None:
        self.model.load_state_dict(saved["model"])
        self.guides.load_state_dict(saved["guides"])
        for optimizer, state in zip(self.optimizers, saved["optimizers"], strict=True):
            optimizer.load_state_dict(state)
        self.average.weights = saved["average"]
        self.step = saved["step"]
        log(f"{self.state_path}: going on from step {self.step}")

    def _save(self) -> None:
        save_state(
            self.state_path,
            model=self.model.state_dict(),
            guides=self.guides.state_dict(),
            optimizers=[optimizer.state_dict() for optimizer in self.optimizers],
            average=self.average.weights,
            step=self.step,
        )

    def train(self) -> None:
        """Run to the last step, or until ``stop``; the state is saved every few minutes and then."""
        saved = said = began = time.monotonic()
        first = self.step
        with ThreadPoolExecutor(1) as pool:
            following = pool.submit(self._sample, self.step)
            while self.step < self.recipe.steps and not self.stopped:
                sampled = following.result()
                following = pool.submit(self._sample, self.step + 1)
                self._take(sampled)
                now = time.monotonic()
                if now - said > 30:
                    said = now
                    self._say((self.step - first) / (now - began))
                if now - saved > 240:
                    saved = now
                    self._save()
        self._save()

    def stop(self, *_: Any) -> None:
        """End after the step in progress: in the middle of one, the state would be neither before nor after it."""
        self.stopped = True

    def _on_clips(self, step: int) -> bool:
        return step % 2 == 1 and step >= self.recipe.clips_from * self.recipe.steps

    def _sample(self, step: int) -> tuple[list[Any], list[Any]]:
        """What a step learns from; a random stream of its own each, so that a resumed run sees the same."""
        rng, recipe = np.random.default_rng([self.recipe.seed, step]), self.recipe
        side = int(rng.choice(recipe.sides))
        alike = (recipe.sides[0] / side) ** 2
        if self._on_clips(step):
            done = (step / recipe.steps - recipe.clips_from) / (1 - recipe.clips_from)
            still = max(1 - done / recipe.still, 1 / 3)
            clips = [
                sample_clip(self.worlds, self.words, rng, recipe.frames, still, side)
                for _ in range(max(1, round(alike * recipe.clips)))
            ]
            return clips, [sample_tracks(clip, rng, recipe.tracks) for clip in clips]
        clips = [
            sample_clip(self.worlds, self.words, rng, 1, side=side)
            for _ in range(max(1, round(alike * recipe.pictures)))
        ]
        return clips, [sample_prompts(clip.labels[:, 0], rng, recipe.points) for clip in clips]

    def _take(self, sampled: tuple[list[Any], list[Any]]) -> None:
        recipe = self.recipe
        on_clips = self._on_clips(self.step)
        rate = learning_rate(recipe.peak_rate, self.step, recipe.steps, recipe.warm_up, recipe.decay)
        for optimizer in self.optimizers:
            optimizer.zero_grad()
            for group in optimizer.param_groups:
                group["lr"] = rate
        set_image_size(self.model, sampled[0][0].pictures.shape[1])
        # The loss draws at random too: each step from a stream of its own, as the samples are.
        torch.manual_seed(recipe.seed * 1_000_003 + self.step)
        begun = recipe.clips_from * recipe.steps if on_clips else 0
        balance = recipe.balance * max(0.0, 1 - (self.step - begun) / recipe.balanced_steps)
        outcome: Outcome = (clip_step if on_clips else picture_step)(
            self.model, self.guides, balance, *sampled
        )
        outcome.loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        if torch.isfinite(norm):
            for optimizer in self.optimizers:
                optimizer.step()
            self.average.update(self.model, self.step)
        else:
            log(f"step {self.step}: gradient not finite, left out")
        self.step += 1
        self.history["clips" if on_clips else "pictures"].append(
            np.r_[outcome.loss.item(), outcome.ious.cpu().numpy()]
        )

    def _say(self, rate: float) -> None:
        left = (self.recipe.steps - self.step) / rate / 60
        texts = [f"step {self.step}/{self.recipe.steps}, {rate:.2f} steps/s, {left:.0f} min left"]
        for name, values in self.history.items():
            if values:
                loss, *ious = np.mean(values, axis=0)
                texts.append(f"{name}: loss {loss:.3f}, IoU {' '.join(f'{iou:.3f}' for iou in ious)}")
        log("; ".join(texts))


if __name__ == "__main__":
    main()
