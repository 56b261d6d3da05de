"""Scores by the protocol of the format ``lerf`` are those of LangSplat's evaluation, written down once more, step by step."""

import cv2
import numpy as np
import pytest

from egosplat.evaluation.options import MetricsOptions
from egosplat.evaluation.queries import Query, categories
from egosplat.evaluation.scores import score_query
from egosplat.frames.recording import Instance
from egosplat.pipeline.config import defaults, of_format, stage_values
from egosplat.query.maps import localize, read_maps, segment
from egosplat_rivals.formats.labeled_annotations import paint_layers

WIDTH, HEIGHT = 986, 120
OPTIONS = MetricsOptions(**stage_values("metrics", of_format(defaults(), "lerf")))
# Two bowls, and an egg that lies in the first.
OUTLINES = {
    "bowl": [[(100, 20), (300, 25), (290, 100), (110, 95)], [(500, 10), (700, 30), (650, 90)]],
    "egg": [[(150, 40), (220, 45), (200, 80)]],
}


def outline_mask(outlines) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for outline in outlines:
        cv2.fillPoly(mask, [np.array(outline, np.int32)], 1)
    return mask > 0


def reference(maps: np.ndarray, category: str) -> tuple[bool, float]:
    """Hit and IoU of the maps of three levels."""
    filtered = [cv2.filter2D(one, -1, np.full((30, 30), 1 / 900, np.float32)) for one in maps]
    peaks = [one.max() for one in filtered]
    place = np.unravel_index(filtered[int(np.argmax(peaks))].argmax(), (HEIGHT, WIDTH))
    boxes = [(*np.min(one, axis=0), *np.max(one, axis=0)) for one in OUTLINES[category]]
    hit = any(left <= place[1] <= right and top <= place[0] <= bottom for left, top, right, bottom in boxes)
    both = [(one + smooth) / 2 for one, smooth in zip(maps, filtered, strict=True)]
    chosen = both[int(np.argmax([one.max() for one in both]))]
    scaled = (chosen - chosen.min()) / (chosen.max() - chosen.min())
    above = np.clip(2 * scaled - 1, 0, 1) > 0.4
    padded = np.pad(above.astype(int), 3, constant_values=-1)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (7, 7))
    mask = (windows == 1).sum(axis=(2, 3)) > (windows == 0).sum(axis=(2, 3))
    truth = outline_mask(OUTLINES[category])
    return hit, float((mask & truth).sum() / (mask | truth).sum())


def answers(seed: int) -> np.ndarray:
    """(3, H, W) float32 relevancies: blobs on a slope, with noise."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    levels = []
    for _ in range(3):
        x, y, size = rng.uniform(130, 330), rng.uniform(30, 90), rng.uniform(15, 60)
        blob = rng.uniform(0.3, 0.5) * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * size**2))
        levels.append(0.3 + blob + 0.02 * rng.random((HEIGHT, WIDTH)) + 1e-4 * u)
    return np.array(levels, np.float32)


@pytest.mark.parametrize("seed", range(6))
def test_hit_and_iou_are_the_reference_s(seed):
    named = [(name, outline) for name, outlines in OUTLINES.items() for outline in outlines]
    instances = [Instance(index + 1, name, name, "static", "object") for index, (name, _) in enumerate(named)]
    masks = [(index, outline_mask([outline])) for index, (_, outline) in enumerate(named)]
    layers, everything = paint_layers(masks, (HEIGHT, WIDTH)), np.ones((HEIGHT, WIDTH), bool)
    found = dict(categories(layers, instances, OPTIONS))
    assert {name: groups["all"] for name, groups in found.items()} == {"bowl": (0, 1), "egg": (2,)}
    for number, (name, groups) in enumerate(found.items()):
        maps = answers(10 * seed + number)
        read = read_maps(maps, everything, OPTIONS)
        _, _, pixel = localize(read.smooth, read.shown)
        _, mask = segment(read, OPTIONS.segmentation_threshold, OPTIONS.majority_px(WIDTH))
        given = Query(0, 0, name, groups), pixel, mask, layers, everything
        score = score_query(*given)["all"]
        hit, iou = reference(maps, name)
        assert score.hit == hit and score.iou == pytest.approx(iou, abs=2e-3)
