"""Reproducible, resumable training of a small OpenCLIP on crops."""

import json
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from open_clip import CLIP, SimpleTokenizer
from torch import Tensor

from egosplat.compute import choose_compute
from egosplat.files import atomic_file
from egosplat.progress import log, track
from training.small_models.attributes import COLORS
from training.small_models.captions import (
    TEMPLATES,
    Captions,
    bank,
    describe,
    facts,
    joined,
    make_claims,
    phrased,
)
from training.small_models.clip_losses import contrastive_loss, neutral_loss, synonym_loss
from training.small_models.clip_model import encode_short_text
from training.small_models.clip_views import DEFAULT, normalized
from training.small_models.concepts import CANONICAL, WHOLES
from training.small_models.crops import KINDS, Crops, sampling_weights
from training.small_models.glossary import COLOR_GLOSSARY, GLOSSARY

_SAVED_EVERY_S = 180.0
_LOGGED_EVERY = 200


@dataclass(frozen=True)
class Schedule:
    """Hyperparameters of the training.

    Attributes:
        steps: number of steps; batch: crops per step; captions: number of them with captions of their own.
        learning_rate: peak, after the warmup steps; it falls to 0 along a cosine. decay: weight decay.
        largest_scale: bound of the scale of cosines in the contrastive loss; synonym_scale: that of the glossary.
        margin: margin of the cosines of canonical phrases.
        neutral, synonyms: weights of their losses.
        recolored: fraction of the crops that are shown in other colors and have no color in their captions.
        squares, tiles, segments: fractions of the batch that are unmasked squares, tiles, and masks of SAM2, of which
            some are squares; the others are masked crops.
    """

    steps: int
    batch: int = 160
    captions: int = 64
    learning_rate: float = 1.5e-3
    warmup: int = 200
    decay: float = 0.05
    largest_scale: float = 40.0
    synonym_scale: float = 20.0
    margin: float = 0.1
    neutral: float = 0.2
    synonyms: float = 0.3
    recolored: float = 0.35
    squares: float = 0.0
    tiles: float = 0.0
    segments: float = 0.0

    def rate(self, step: int) -> float:
        """Learning rate of a step."""
        return (
            self.learning_rate
            * min(1.0, (step + 1) / self.warmup)
            * 0.5
            * (1 + math.cos(math.pi * step / self.steps))
        )


_WEIGHTS = {"whole": 1.0, "kind": 0.3, "part": 0.6, "color": 0.5, "pattern": 0.4, "material": 0.4}
# Weight of captions in the contrastive loss.
_DESCRIBED = 0.7

# Words of the glossary per step: alone, and with a color.
_GLOSSED, _COLORED = 32, 16


class Trainer:
    """A model, its training data and its progress."""

    def __init__(
        self,
        model: CLIP,
        tokenizer: SimpleTokenizer,
        crops: Crops,
        schedule: Schedule,
        seed: int,
        device: str,
    ) -> None:
        """Args: ``crops`` are the training crops."""
        self.model = model.to(device, memory_format=torch.channels_last)
        self.crops, self.schedule, self.device = crops, schedule, device
        self._compute = choose_compute(device, "auto")
        self.claims = make_claims(sorted(set(crops.names.tolist())))
        self.facts = facts(self.claims, crops)
        self.step = 0
        self._tokenizer = tokenizer
        self._known: dict[str, Tensor] = {}
        self._rng = np.random.default_rng(seed)
        self._torch_rng = torch.Generator().manual_seed(seed)
        shares = (schedule.tiles, schedule.segments)
        self._reach = np.cumsum(sampling_weights(crops.names, crops.kind, *shares))
        matrices = [value for value in model.parameters() if value.ndim > 1]
        others = [value for value in model.parameters() if value.ndim <= 1]
        # As in CLIP: no weight decay on biases and gains.
        groups = [
            {"params": matrices, "weight_decay": schedule.decay},
            {"params": others, "weight_decay": 0.0},
        ]
        self._optimizer = torch.optim.AdamW(groups, betas=(0.9, 0.98))

    def run(self, state: Path, until: int) -> None:
        """Train until a step, from that of ``state``, which is saved every few minutes and at the end."""
        if state.exists():
            self._load(torch.load(state, weights_only=True, map_location="cpu"))
            log(f"resuming at step {self.step}")
        self.model.train()
        saved, losses = time.monotonic(), []
        for _ in track(range(until - self.step), "training", unit="step"):
            losses.append(self._advance())
            if self.step % _LOGGED_EVERY == 0:
                log(f"step {self.step}: " + ", ".join(f"{value:.3f}" for value in np.mean(losses, axis=0)))
                losses = []
            if time.monotonic() - saved > _SAVED_EVERY_S:
                self._save(state)
                saved = time.monotonic()
        self._save(state)

    def _advance(self) -> list[float]:
        """Train one step; returns the losses: contrastive, neutral, synonyms."""
        for group in self._optimizer.param_groups:
            group["lr"] = self.schedule.rate(self.step)
        chosen = np.searchsorted(self._reach, self._rng.random(self.schedule.batch) * self._reach[-1])
        tile = self.crops.kind[chosen] == KINDS.index("tile")
        masked = draw_masked(tile, self.schedule, self._rng)
        known = self.facts[chosen]
        other = self._rng.random(len(chosen)) < self.schedule.recolored
        known[np.ix_(other, self.claims.columns("color"))] = -1
        # At least 0.5 rad, so that a recolored crop really has another color.
        hues = torch.from_numpy(other * self._rng.uniform(0.5, 2 * np.pi - 0.5, len(chosen)))
        captions = joined(
            bank(self.claims, self._rng), describe(self.claims, known[: self.schedule.captions], self._rng)
        )
        views = DEFAULT.views(
            self.crops.patches[chosen], torch.from_numpy(masked), hues.float(), self._torch_rng, self.device
        )
        losses = self._losses(views, captions, captions.truth(known))
        self._optimizer.zero_grad()
        (losses[0] + self.schedule.neutral * losses[1] + self.schedule.synonyms * losses[2]).backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self._optimizer.step()
        self.step += 1
        return [float(loss.detach()) for loss in losses]

    def _losses(self, views: Tensor, captions: Captions, truth: np.ndarray) -> list[Tensor]:
        schedule = self.schedule
        words, colors, target = self._gloss(captions)
        texts = [*captions.texts, *CANONICAL, *colors, *words]
        views = views.contiguous(memory_format=torch.channels_last)
        # Without instructions for it, bfloat16 takes a processor ten times as long.
        with self._compute.mixed():
            images = self.model.encode_image(normalized(views), normalize=True).float()
            said = encode_short_text(self.model, self._tokens(texts)).float()
        count = len(captions.texts)
        said, canonical, colored, glossed = said.split([count, len(CANONICAL), len(colors), len(words)])
        cosines = images @ said.T
        true = torch.from_numpy(truth).to(self.device)
        scale = self.model.logit_scale.exp().clamp(max=schedule.largest_scale)
        meanings = torch.cat([said, colored])
        return [
            contrastive_loss(scale * cosines, true, self._weights(count)),
            neutral_loss(cosines, images @ canonical.T, true, schedule.margin, float(scale.detach())),
            synonym_loss(glossed, meanings, torch.tensor(target, device=self.device), schedule.synonym_scale),
        ]

    def _weights(self, count: int) -> Tensor:
        weights = torch.full((count,), _DESCRIBED, device=self.device)
        place = 0
        for group, weight in _WEIGHTS.items():
            size = len(self.claims.columns(group))
            weights[place : place + size] = weight
            place += size
        return weights

    def _gloss(self, captions: Captions) -> tuple[list[str], list[str], list[int]]:
        """Glossary words, additional captions with a color, and the index of the caption that each word means."""
        rng, names = self._rng, list(GLOSSARY)
        first = captions.columns[:, 0].tolist()
        meaning = {
            name: first.index(column)
            for name, column in zip(WHOLES, self.claims.columns("whole"), strict=True)
        }
        words, target = [], []
        # A synonym alone means the caption with the name alone, which ``bank`` always has.
        for name in rng.choice(names, _GLOSSED, replace=False).tolist():
            words.append(phrased(str(rng.choice(TEMPLATES)), str(rng.choice(GLOSSARY[name]))))
            target.append(meaning[name])
        for color, column in zip(COLORS, self.claims.columns("color"), strict=True):
            words.append(f"{rng.choice(COLOR_GLOSSARY[color])} object")
            target.append(first.index(column))
        colored = []
        for name in rng.choice(names, _COLORED, replace=False).tolist():
            color = str(rng.choice(COLORS))
            said = str(rng.choice(COLOR_GLOSSARY[color])) if rng.random() < 0.5 else color
            words.append(f"{said} {rng.choice(GLOSSARY[name])}")
            target.append(len(captions.texts) + len(colored))
            colored.append(f"{color} {rng.choice(WHOLES[name])}")
        return words, colored, target

    def _tokens(self, texts: list[str]) -> Tensor:
        for text in texts:
            # Tokenisation in Python is slow, and texts repeat from step to step.
            if text not in self._known:
                self._known[text] = self._tokenizer([text])[0]
        return torch.stack([self._known[text] for text in texts]).to(self.device)

    def _save(self, path: Path) -> None:
        state = {
            "step": self.step,
            "model": self.model.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "torch_rng": self._torch_rng.get_state(),
            "rng": json.dumps(self._rng.bit_generator.state),
        }
        with atomic_file(path) as made:
            torch.save(state, made)

    def _load(self, state: dict[str, Any]) -> None:
        self.step = state["step"]
        self.model.load_state_dict(state["model"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._torch_rng.set_state(state["torch_rng"])
        self._rng.bit_generator.state = json.loads(state["rng"])


def draw_masked(tile: np.ndarray, schedule: Schedule, rng: np.random.Generator) -> np.ndarray:
    """(B,) whether each crop is shown masked; ``schedule.squares`` is a fraction of the batch, tiles included."""
    return ~tile & (rng.random(len(tile)) * (1 - schedule.tiles) >= schedule.squares)
