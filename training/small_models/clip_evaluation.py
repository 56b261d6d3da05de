"""Evaluation of a small OpenCLIP on crops of held-out worlds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from open_clip import CLIP, SimpleTokenizer
from torch import Tensor

from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from training.small_models.attributes import COLORS
from training.small_models.captions import Claims, Truth, facts, main_color, make_claims, unseen_combination
from training.small_models.clip_model import encode_texts
from training.small_models.clip_views import framed, half_planes, normalized, plain_views, split_patches
from training.small_models.concepts import CANONICAL, WHOLES
from training.small_models.crops import OWN_ARMS, Crops
from training.small_models.glossary import COLOR_GLOSSARY, GLOSSARY
from training.small_models.levels import LEVELS

_BATCH = 512
_TEMPERATURE = 10.0

# Ranges of the side of crops' bounding squares [px], first and end.
SIZES = ((0, 15), (15, 30), (30, 60), (60, 10_000))


@dataclass(frozen=True)
class Score:
    """A fraction of correct answers and the number of crops."""

    share: float
    count: int

    def __str__(self) -> str:
        return f"{self.share:.3f} ({self.count:,})" if self.count else "-"


def mean(right: NDArray[np.bool_]) -> Score:
    """Fraction of correct answers."""
    return Score(float(np.mean(right)) if len(right) else float("nan"), len(right))


@torch.no_grad()
def encode_patches(
    model: CLIP, patches: NDArray[np.uint8], masked: bool = True, covered: float = 0.0, seed: int = 0
) -> Tensor:
    """(N, D) features of unit norm; a fraction of each mask can be covered from a random side, if masked."""
    rng = torch.Generator().manual_seed(seed)
    features = []
    for first in range(0, len(patches), _BATCH):
        few = patches[first : first + _BATCH]
        if covered:
            pictures, masks = split_patches(few, "cpu")
            masks = masks * half_planes(masks, rng, share=covered)
            views = framed(pictures * masks, masks, torch.zeros(len(few)))
        else:
            views = plain_views(few, masked)
        features.append(model.encode_image(normalized(views), normalize=True))
    return torch.cat(features)


class Exam:
    """Questions to a model about crops of worlds that it was not trained on."""

    def __init__(self, model: CLIP, tokenizer: SimpleTokenizer, crops: Crops, masked: bool = True) -> None:
        """Args: ``model`` must be in evaluation mode; masked: whether it sees crops black outside their masks."""
        self.model, self.tokenizer, self.crops = model, tokenizer, crops
        self.claims: Claims = make_claims(sorted(set(crops.names.tolist())))
        self.facts: Truth = facts(self.claims, crops)
        self.features = encode_patches(model, crops.patches, masked)
        self.whole = crops.level == LEVELS.index("whole")
        self.thing = self.whole & np.isin(crops.names, list(CATEGORY_UIDS))
        self.building = self.whole & ~self.thing & (crops.names != OWN_ARMS)
        self.color = main_color(crops)
        self.unseen = unseen_combination(crops)
        self.names = np.array(list(WHOLES))
        self.truth = np.searchsorted(np.sort(self.names), crops.names)
        self.truth = np.argsort(self.names)[np.clip(self.truth, 0, len(self.names) - 1)]

    def texts(self, phrases: Sequence[str]) -> Tensor:
        """(T, D) text features of unit norm."""
        return encode_texts(self.model, self.tokenizer, list(phrases))

    def categories(self, which: NDArray[np.bool_], features: Tensor | None = None, top: int = 1) -> Score:
        """Fraction of wholes whose name is among the ``top`` nearest of all wholes' names."""
        logits = (self.features if features is None else features)[which] @ self.texts(self.names).T
        best = logits.topk(top, dim=1).indices.numpy()
        return mean((best == self.truth[which][:, None]).any(axis=1))

    def objects(self, which: NDArray[np.bool_]) -> Score:
        """``categories`` for objects instead of crops: from the mean features of all crops of an object."""
        rows = np.flatnonzero(which)
        keys = np.stack([self.crops.world[rows], self.crops.whole[rows]], axis=1)
        _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        # The norm of the sum does not matter for the nearest text.
        total = torch.zeros(len(first), self.features.shape[1])
        total.index_add_(0, torch.from_numpy(number.ravel()), self.features[which])
        best = (total @ self.texts(self.names).T).argmax(dim=1).numpy()
        return mean(best == self.truth[rows[first]])

    def covered(self, which: NDArray[np.bool_], share: float) -> Score:
        """``categories`` with a fraction of each mask covered."""
        return self.categories(which, self._everywhere(which, share))

    def _everywhere(self, which: NDArray[np.bool_], share: float) -> Tensor:
        features = torch.zeros_like(self.features)
        patches = self.crops.patches[which]
        features[torch.from_numpy(which)] = encode_patches(self.model, patches, covered=share)
        return features

    def pictures_of(self, texts: dict[str, Sequence[str]], which: NDArray[np.bool_], top: int = 1) -> Score:
        """Precision of the ``top`` nearest crops of each text; names with fewer crops are skipped."""
        right = []
        for name, phrases in texts.items():
            if (self.crops.names[which] == name).sum() < top:
                continue
            found = (self.texts(phrases) @ self.features[which].T).topk(top, dim=1).indices.numpy()
            right += (self.crops.names[which][found] == name).ravel().tolist()
        return mean(np.array(right, dtype=bool))

    def synonyms(self, which: NDArray[np.bool_]) -> Score:
        """``categories`` with a synonym in place of the crop's name, for every synonym that is in no caption."""
        right = []
        base = self.texts(self.names)
        for name, phrases in GLOSSARY.items():
            column = int(np.flatnonzero(self.names == name)[0])
            mine = self.features[which & (self.crops.names == name)]
            for text in self.texts(phrases):
                bank = base.clone()
                bank[column] = text
                right += ((mine @ bank.T).argmax(dim=1) == column).tolist()
        return mean(np.array(right, dtype=bool))

    def one_of(self, group: str, which: NDArray[np.bool_], template: str = "{}") -> Score:
        """Fraction of crops for which the nearest text of a group is true, among crops with a true one."""
        columns = list(self.claims.columns(group))
        asked = which & (self.facts[:, columns] == 1).any(axis=1)
        texts = self.texts([template.format(self.claims.phrases[column][0]) for column in columns])
        best = (self.features[asked] @ texts.T).argmax(dim=1).numpy()
        return mean(self.facts[asked][np.arange(len(best)), np.array(columns)[best]] == 1)

    def color_words(self, which: NDArray[np.bool_], words: dict[str, Sequence[str]]) -> Score:
        """Fraction of crops whose color is named correctly, with the first word for each color."""
        asked = which & (self.color >= 0)
        texts = self.texts([f"{words[color][0]} object" for color in COLORS])
        return mean((self.features[asked] @ texts.T).argmax(dim=1).numpy() == self.color[asked])

    def combinations(self, which: NDArray[np.bool_]) -> Score:
        """Fraction of objects with the right "color category", among all colors and categories."""
        asked = which & self.thing & (self.color >= 0)
        texts = self.texts([f"{color} {name}" for name in self.names for color in COLORS])
        best = (self.features[asked] @ texts.T).argmax(dim=1).numpy()
        return mean(best == self.truth[asked] * len(COLORS) + self.color[asked])

    def relevancy(self, which: NDArray[np.bool_]) -> tuple[Score, Score]:
        """Fractions of true and of false names with a relevancy of at least one half."""
        canonical = self.features[which] @ self.texts(CANONICAL).T
        logits = self.features[which] @ self.texts(self.names).T
        relevant = _TEMPERATURE * (logits - canonical.max(dim=1, keepdim=True).values) >= 0
        true = self.facts[which][:, list(self.claims.columns("whole"))]
        return mean(relevant.numpy()[true == 1]), mean(relevant.numpy()[true == 0])


def table(exam: Exam) -> dict[str, Score]:
    """All scores by name."""
    crops, thing = exam.crops, exam.thing
    large = thing & (crops.side >= 30)
    scores = {
        "category, top 1": exam.categories(thing),
        "category, top 5": exam.categories(thing, top=5),
        "category of an object, features averaged over its crops": exam.objects(thing),
    }
    for low, high in SIZES:
        named = f"{low} to {high - 1} px" if high < 10_000 else f"{low} px and more"
        scores[f"category, top 1, {named}"] = exam.categories(
            thing & (crops.side >= low) & (crops.side < high)
        )
    scores |= {
        "category, top 1, half of it covered": exam.covered(thing, 0.5),
        "category, top 1, half of it covered, 30 px and more": exam.covered(large, 0.5),
        "category of unseen color x category": exam.categories(thing & exam.unseen),
        "category of unseen color x category, 30 px and more": exam.categories(large & exam.unseen),
        "category of an object of unseen color x category": exam.objects(thing & exam.unseen),
        "piece of the building, top 1": exam.categories(exam.building),
        "first crop found is right, by name": exam.pictures_of({name: [name] for name in GLOSSARY}, thing),
        "first crop found is right, synonyms of no caption": exam.pictures_of(GLOSSARY, thing),
        "first five crops found, by name": exam.pictures_of({name: [name] for name in GLOSSARY}, thing, 5),
        "first five crops found, synonyms of no caption": exam.pictures_of(GLOSSARY, thing, 5),
        "category, top 1, synonyms of no caption": exam.synonyms(exam.whole),
        "part": exam.one_of("part", ~exam.whole),
        "color": exam.one_of("color", thing, "{} object"),
        "color, synonyms of no caption": exam.color_words(thing, COLOR_GLOSSARY),
        "color and category": exam.combinations(~exam.unseen),
        "color and category, unseen together": exam.combinations(exam.unseen),
        "material": exam.one_of("material", thing, "{} object"),
        "pattern": exam.one_of("pattern", thing, "{} object"),
    }
    true, false = exam.relevancy(thing)
    return scores | {"relevancy of the true name >= 0.5": true, "relevancy of another name >= 0.5": false}


def table_of_kinds(exams: dict[str, Exam]) -> dict[str, dict[str, Score]]:
    """Scores of each kind of crop by name: accuracy of single crops and of objects, and relevancy."""
    scores = {}
    for kind, exam in exams.items():
        true, false = exam.relevancy(exam.thing)
        scores[kind] = {
            "category, top 1": exam.categories(exam.thing),
            "category, top 5": exam.categories(exam.thing, top=5),
            "category of an object": exam.objects(exam.thing),
            "piece of the building": exam.categories(exam.building),
            "true name relevant": true,
            "another name relevant": false,
        }
    return scores


def worst(exam: Exam, count: int = 8) -> list[tuple[str, Score]]:
    """The categories with the lowest scores."""
    names = [name for name in WHOLES if (exam.thing & (exam.crops.names == name)).any()]
    scores = [(name, exam.categories(exam.thing & (exam.crops.names == name))) for name in names]
    return sorted(scores, key=lambda one: one[1].share)[:count]
