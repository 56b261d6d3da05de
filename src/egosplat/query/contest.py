"""How a query stands among other words: as evidence for grades, and among words of homes for models without a calibration
(docs/models.md#calibrate)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from egosplat.images import evenly_spaced
from egosplat.models.clip import OpenClip
from egosplat.query.answers import Thing
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene
from egosplat.query.text import Texts, encode_phrases, other_meanings, untaught_words

# Words of things of homes, a comma between two; of these, the nearest to a query may mean the same.
WORDS, _NEAREST = Path(__file__).with_name("household.csv"), 12

# Gaussians that tell what is usual in a scene, and that stand for a thing.
_OF_SCENE, _OF_THING = 2048, 256


def _log_odds(scene: QueryScene, texts: Texts, options: QueryOptions) -> Tensor:
    """(Q, K) log-odds of the relevancy of each code of Gaussians, on the CPU."""
    return torch.logit(scene.relevancy(texts, options)[:, scene.share.T > 0], eps=1e-6).cpu()


def fits_of(scene: QueryScene, thing: Thing, texts: Texts, options: QueryOptions) -> Tensor:
    """(Q,) mean log-odds of the relevancy of a thing's Gaussians, by looks alone."""
    rows = torch.from_numpy(thing.members)[evenly_spaced(len(thing.members), _OF_THING)]
    code, share = (each[rows, scene.levels.index(thing.level), None] for each in (scene.code, scene.share))
    some = replace(scene, code=code, share=share, levels=[thing.level], sizes=None)
    return _log_odds(some, texts, options).mean(dim=1)


def leads_of(
    scene: QueryScene, things: Sequence[Thing], query: Texts, words: Texts, options: QueryOptions
) -> list[float]:
    """By how much the log-odds of one query are above those of words of other meanings, and of canonical phrases, at each thing."""
    others = other_meanings(query, words).tolist() if words.phrases else []
    names = words.of([word for word, is_other in zip(words.phrases, others, strict=True) if is_other])
    asked = _behind(replace(names, canonical=query.canonical), query)
    fits = [fits_of(scene, thing, asked, options).tolist() for thing in things]
    return [own - max([0.0, *rest]) for *rest, own in fits]


def _behind(words: Texts, query: Texts) -> Texts:
    """Words, of which there may be none, and one query behind them."""
    queries = torch.cat([each.queries for each in (words, query) if each.phrases])
    return replace(words, phrases=(*words.phrases, ""), queries=queries)


class Contest:
    """Words of homes against which a query has to win, by the softmax that an OpenCLIP was trained with.

    It compares how much better each fits a thing than the scene: a word that fits everything wins nothing."""

    def __init__(self, scene: QueryScene, clip: OpenClip, options: QueryOptions) -> None:
        """Compare the words that a model knows, and canonical phrases, with the scene."""
        listed = [word.strip() for word in WORDS.read_text().replace("\n", ",").split(",")]
        words = dict.fromkeys((*filter(None, listed), *options.canonical))
        words = tuple(word for word in words if word in options.canonical or not untaught_words(clip, word))
        canonical = encode_phrases(clip, options.canonical)
        self.words = Texts(words, encode_phrases(clip, words, short=True), canonical)
        self.options, self.scene = options.change(temperature=1.0), replace(scene, sizes=None)
        self.scale = float(clip.model.logit_scale.exp())
        coded = (scene.share > 0).any(dim=1).nonzero()[:, 0].cpu()
        rows = coded[evenly_spaced(len(coded), _OF_SCENE)]
        self.sample = replace(self.scene, code=scene.code[rows], share=scene.share[rows])
        self.usual = self._fits(self.words).mean(dim=1)

    def best(self, query: Texts) -> float:
        """How well one query stands where it stands best, 0 to 1."""
        fits = self._fits(_behind(self.words, query))
        return float(self._stand(query, fits, fits.mean(dim=1)).amax()) if fits.numel() else 0.0

    def rate(self, query: Texts, things: Sequence[Thing], least: float) -> list[Thing]:
        """Things that match one query, the best first, by how well it stands there.

        That becomes their score, or 0 where their score is below the ``least``."""
        usual, rated = torch.cat([self.usual, self._fits(query).mean(dim=1)]), []
        asked = _behind(self.words, query)
        for thing in things:
            fits = fits_of(self.scene, thing, asked, self.options)[:, None]
            stands = float(self._stand(query, fits, usual))
            rated.append(replace(thing, score=stands if thing.score >= least else 0.0))
        return sorted(rated, key=lambda one: -one.score)

    def _fits(self, texts: Texts) -> Tensor:
        """(Q, K) by how much each text fits each code of the sample better than each canonical phrase does."""
        return _log_odds(self.sample, replace(texts, canonical=self.words.canonical), self.options)

    def _stand(self, query: Texts, fits: Tensor, usual: Tensor) -> Tensor:
        """(K,) share of the query among words of other meanings, by (W + 1, K) fits, its own last, and (W + 1,) usual ones."""
        apart = self.scale * (fits - usual[:, None])
        rivals = apart[:-1][other_meanings(query, self.words, _NEAREST)]
        return torch.sigmoid(apart[-1] - rivals.logsumexp(dim=0))
