"""Hyperparameters of SAM2's training."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Recipe:
    """Hyperparameters of a run; with the worlds and the seed they determine the result.

    Attributes:
        steps: total number of steps; clips_from: fraction of them after which one step in ``clips_every`` is on clips.
        sides: image sides to train on, equally often; one named twice is drawn twice as often [px]. The model should work at each of them.
        pictures, points: batch size and prompts of an image step; clips, frames, tracks: of a clip step. The batch
            sizes are those at the first side; at another side they are scaled to take the same time.
        peak_rate, warm_up, decay: see ``learning_rate``; average: see ``Average``.
        still: fraction of the clip steps at the beginning over which clips of one drifting image are replaced by
            rendered clips; a third of the drifting ones remain.
        place_scale: frequencies of the decoder's positional encoding, as multiples of SAM2's.
        balance: initial value, see ``mask_loss``; it falls to 0 over ``balanced_steps`` of each kind of step.
        guided: whether ``Guides`` add auxiliary losses.
    """

    steps: int
    seed: int
    clips_from: float = 0.6
    clips_every: int = 2
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
    guided: bool = True

    def on_clips(self, step: int) -> bool:
        """Whether a step is on clips; the others are on single images."""
        return step >= self.clips_from * self.steps and step % self.clips_every == self.clips_every - 1


def recipe_from_weights(steps: int, seed: int, peak_rate: float) -> Recipe:
    """The recipe that trains given weights further: single images at the sizes of whole frames and of crops of them.

    ``segments`` finds small things in crops of 320 px, and a step at 320 px has 2.6 times as many images as one at 512 px.
    Clips are seldom, but from the first step on, so that propagation is not forgotten.
    """
    return Recipe(
        steps,
        seed,
        sides=(512, 384, 320, 320),
        clips_from=0.0,
        clips_every=16,
        pictures=2,
        clips=1,
        still=0.0,
        peak_rate=peak_rate,
        warm_up=40,
        average=0.996,
        balance=0.0,
        guided=False,
    )
