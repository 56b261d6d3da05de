"""Train the small SAM2 on rendered worlds.

    python -m training.render_worlds data/training --worlds 300
    python -m training.sam2 data/training --output src/egosplat/models/small_sam2 --state data/sam2.pt

The same command resumes an interrupted run. Training starts with single images and point prompts. Later, every
other step is on clips, in which masks are propagated by memory.
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
from training.small_models.worlds import RenderedWorld, read_world

CONFIG = Path(__file__).parents[1] / "src/egosplat/models/small_sam2/sam2.yaml"


@dataclass(frozen=True)
class Recipe:
    """Hyperparameters of a run; with the worlds and the seed they determine the result.

    Attributes:
        steps: total number of steps; clips_from: fraction of them after which every other step is on clips.
        sides: image sides to train on, equally often [px]; the model should work at each of them.
        pictures, points: batch size and prompts of an image step; clips, frames, tracks: of a clip step. The batch
            sizes are those at the first side; at another side they are scaled to take the same time.
        peak_rate, warm_up, decay: see ``learning_rate``; average: see ``Average``.
        still: fraction of the clip steps at the beginning over which clips of one drifting image are replaced by
            rendered clips; a third of the drifting ones remain.
        place_scale: frequencies of the decoder's positional encoding, as multiples of SAM2's.
        balance: initial value, see ``mask_loss``; it falls to 0 over ``balanced_steps`` of each kind of step.
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
    parser.add_argument("worlds", type=Path, help="folder of rendered worlds")
    parser.add_argument("--output", type=Path, required=True, help="folder for model.safetensors")
    parser.add_argument("--state", type=Path, required=True, help="file of the resumable state")
    parser.add_argument("--start", type=Path, help="initial weights (.safetensors; default: random)")
    parser.add_argument("--steps", type=int, default=16_000, help="number of steps")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=2, help="CPU threads")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    worlds = [read_world(folder) for folder in sorted(args.worlds.glob("[0-9]*"))]
    if not worlds:
        raise SystemExit(
            f"{args.worlds}: no worlds found. Run: python -m training.render_worlds {args.worlds} --worlds 300"
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
        raise SystemExit(f"stopped at step {run.step}; run the same command to resume")
    args.output.mkdir(parents=True, exist_ok=True)
    with atomic_file(args.output / "model.safetensors") as scratch:
        save_file(half_precision(run.average.weights), scratch)
    log(f"{args.output / 'model.safetensors'} written")


def recipe_of(args: argparse.Namespace) -> Recipe:
    """The recipe of the command line; from given weights, a lower learning rate and no class balance."""
    if args.start is None:
        return Recipe(args.steps, args.seed)
    return Recipe(args.steps, args.seed, peak_rate=8e-4, balance=0.0)


class Run:
    """A training run: model, optimizers, averaged weights and the current step."""

    def __init__(
        self,
        recipe: Recipe,
        worlds: list[RenderedWorld],
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
        """Muon for the matrices of linear layers, AdamW for the rest; Muon's rate is scaled to match AdamW's."""
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
        log(f"{self.state_path}: resuming at step {self.step}")

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
        """Train to the last step or until ``stop``; save the state every few minutes and at the end."""
        saved = said = began = time.monotonic()
        first = self.step
        with ThreadPoolExecutor(1) as pool:
            following = pool.submit(self._sample, self.step)
            while self.step < self.recipe.steps and not self.stopped:
                sampled = following.result()
                # Draw the next samples while this step trains.
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
        """Stop after the current step."""
        # Stopping inside a step would save a state between two steps.
        self.stopped = True

    def _on_clips(self, step: int) -> bool:
        return step % 2 == 1 and step >= self.recipe.clips_from * self.recipe.steps

    def _sample(self, step: int) -> tuple[list[Any], list[Any]]:
        """Draw the samples of a step from its own random stream, so that a resumed run sees the same samples."""
        rng, recipe = np.random.default_rng([self.recipe.seed, step]), self.recipe
        side = int(rng.choice(recipe.sides))
        # The cost of a step grows with the area of its images.
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
        # The loss draws random pixels: seed each step, so that a resumed run draws the same ones.
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
            log(f"step {self.step}: gradient not finite, step skipped")
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
