"""Train the small SAM2 on rendered worlds.

    python -m training.render_worlds data/training --worlds 300
    python -m training.sam2 data/training --output src/egosplat/models/small_sam2 --state data/sam2.pt

The same command resumes an interrupted run; with the same number of threads the result is the same to the bit.
Training is on single images with point prompts and on clips, in which masks are propagated by memory.
With --held-out, scores on other worlds are written into curve.tsv in the folder of the state.
"""

import argparse
import copy
import random
import signal
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
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
from egosplat.progress import log, show_log
from training.small_models.sam2_curve import held_out_scores, write_curve
from training.small_models.sam2_data import sample_clip, sample_prompts, sample_tracks, vocabulary
from training.small_models.sam2_losses import Guides
from training.small_models.sam2_recipe import Recipe, recipe_from_weights
from training.small_models.sam2_steps import Outcome, clip_step, picture_step
from training.small_models.schedule import Average, half_precision, learning_rate, read_state, save_state
from training.small_models.worlds import RenderedWorld, read_world

CONFIG = Path(__file__).parents[1] / "src/egosplat/models/small_sam2/sam2.yaml"


def main() -> None:
    """Parse the command line and train."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("worlds", type=Path, help="folder of rendered worlds")
    parser.add_argument("--output", type=Path, required=True, help="folder for model.safetensors")
    parser.add_argument("--state", type=Path, required=True, help="file of the resumable state")
    parser.add_argument("--start", type=Path, help="initial weights (.safetensors; default: random)")
    parser.add_argument("--steps", type=int, default=16_000, help="number of steps")
    parser.add_argument("--rate", type=float, default=4e-4, help="largest learning rate with --start")
    parser.add_argument(
        "--held-out", type=Path, help="folder of the worlds of the learning curve (default: none)"
    )
    parser.add_argument("--every", type=int, default=500, help="steps between the rows of the learning curve")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=2, help="CPU threads")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    how = args.steps, args.seed
    recipe = recipe_from_weights(*how, args.rate) if args.start else Recipe(*how)
    try:
        worlds = read_worlds(args.worlds)
        held_out = read_worlds(args.held_out) if args.held_out else []
        log(f"{len(worlds)} worlds, {args.steps} steps")
        run = Run(recipe, worlds, args.state, torch.device(args.device), args.start, held_out, args.every)
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


def read_worlds(folder: Path) -> list[RenderedWorld]:
    """Read all worlds in a folder.

    Raises:
        UserError: there are none.
    """
    worlds = [read_world(one) for one in sorted(folder.glob("[0-9]*"))]
    if not worlds:
        raise UserError(
            f"{folder}: no worlds found. Run: python -m training.render_worlds {folder} --worlds 180"
        )
    return worlds


class Run:
    """A training run: model, optimizers, averaged weights, the current step and the learning curve."""

    def __init__(
        self,
        recipe: Recipe,
        worlds: list[RenderedWorld],
        state: Path,
        device: torch.device,
        start: Path | None = None,
        held_out: Sequence[RenderedWorld] = (),
        every: int = 1,
    ) -> None:
        random.seed(recipe.seed)
        torch.manual_seed(recipe.seed)
        self.recipe, self.worlds, self.state_path = recipe, worlds, state
        self.held_out, self.every = held_out, every
        # Threads that draw samples. A GPU takes less time for a step than one thread for its samples.
        self.samplers = 1 if device.type == "cpu" else torch.get_num_threads()
        self.step, self.stopped = 0, False
        self.curve: list[dict[str, float]] = []
        self.earlier_s = -time.process_time()
        self.model: SAM2Base = instantiate(OmegaConf.load(CONFIG).model, _recursive_=True).to(device).train()
        self.model.sam_prompt_encoder.pe_layer.positional_encoding_gaussian_matrix.mul_(recipe.place_scale)
        if start is not None:
            load_weights(self.model, read_tensors(start), start, SAM2)
        self.words = vocabulary(worlds)
        self.guides = Guides(self.model.hidden_dim, len(self.words), recipe.guided).to(device)
        self.optimizers = self._optimizers()
        self.average = Average(self.model, recipe.average)
        self.history = {kind: deque[list[float]](maxlen=100) for kind in ("pictures", "clips")}
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

    def _made_of(self) -> dict[str, Any]:
        """What a resumed run must share with the stopped one. The number of steps may change."""
        recipe = {name: value for name, value in asdict(self.recipe).items() if name != "steps"}
        return {"worlds": [len(self.worlds), *self.words], **recipe}

    def _restore(self, saved: dict[str, Any]) -> None:
        differs = [name for name, value in self._made_of().items() if saved["made_of"].get(name) != value]
        if differs:
            raise UserError(
                f"{self.state_path}: of a run with other {', '.join(differs)}; continue with the same ones, or "
                "remove the file to start again"
            )
        self.model.load_state_dict(saved["model"])
        self.guides.load_state_dict(saved["guides"])
        for optimizer, state in zip(self.optimizers, saved["optimizers"], strict=True):
            optimizer.load_state_dict(state)
        self.average.weights = saved["average"]
        self.step, self.curve = saved["step"], saved["curve"]
        self.earlier_s += saved["seconds"]
        for kind, values in saved["history"].items():
            self.history[kind].extend(values)
        log(f"{self.state_path}: resuming at step {self.step}")

    def _save(self) -> None:
        save_state(
            self.state_path,
            model=self.model.state_dict(),
            guides=self.guides.state_dict(),
            optimizers=[optimizer.state_dict() for optimizer in self.optimizers],
            average=self.average.weights,
            step=self.step,
            made_of=self._made_of(),
            curve=self.curve,
            history={kind: list(values) for kind, values in self.history.items()},
            seconds=self.earlier_s + time.process_time(),
        )

    def train(self) -> None:
        """Train to the last step or until ``stop``; save the state every few minutes and at the end."""
        saved = said = began = time.monotonic()
        first = self.step
        with ThreadPoolExecutor(self.samplers) as pool:
            # Samples of the next steps are drawn while one trains.
            coming = deque(pool.submit(self._sample, first + number) for number in range(self.samplers))
            self._measure()
            while self.step < self.recipe.steps and not self.stopped:
                sampled = coming.popleft().result()
                coming.append(pool.submit(self._sample, self.step + self.samplers))
                self._take(sampled)
                self._measure()
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

    def _measure(self) -> None:
        """Add a row to the learning curve if this step has one and it is not there yet."""
        due = self.step % self.every == 0 or self.step == self.recipe.steps
        if self.held_out and due and self.step not in [row["step"] for row in self.curve]:
            model = copy.deepcopy(self.model)
            model.load_state_dict(self.average.weights)
            scores = held_out_scores(model, self.guides, self.held_out, max(self.recipe.sides))
            losses = {f"loss of {kind}": _means(values)[0] for kind, values in self.history.items()}
            hours = (self.earlier_s + time.process_time()) / 3600
            self.curve.append({"step": self.step, "core-hours": hours, **scores, **losses})
        # Rows are part of the state: those that a killed run wrote after its last state are dropped and measured again.
        if self.curve:
            write_curve(self.state_path.with_name("curve.tsv"), self.curve)

    def _sample(self, step: int) -> tuple[list[Any], list[Any]]:
        """Draw the samples of a step from its own random stream, so that a resumed run sees the same samples."""
        rng, recipe = np.random.default_rng([self.recipe.seed, step]), self.recipe
        side = int(rng.choice(recipe.sides))
        # The cost of a step grows with the area of its images.
        alike = (recipe.sides[0] / side) ** 2
        if recipe.on_clips(step):
            done = (step / recipe.steps - recipe.clips_from) / (1 - recipe.clips_from)
            still = max(1 - done / max(recipe.still, 1e-9), 1 / 3)
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
        on_clips = recipe.on_clips(self.step)
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
            [outcome.loss.item(), *outcome.ious.tolist()]
        )

    def _say(self, rate: float) -> None:
        left = (self.recipe.steps - self.step) / rate / 60
        texts = [f"step {self.step}/{self.recipe.steps}, {rate:.2f} steps/s, {left:.0f} min left"]
        for name, values in self.history.items():
            if values:
                loss, *ious = _means(values)
                texts.append(f"{name}: loss {loss:.3f}, IoU {' '.join(f'{iou:.3f}' for iou in ious)}")
        log("; ".join(texts))


def _means(values: Sequence[list[float]]) -> list[float]:
    """Means of loss and IoUs over steps; NaN if there are none."""
    return np.mean(values, axis=0).tolist() if values else [float("nan")]


if __name__ == "__main__":
    show_log()
    main()
