"""The kinds of crops are examined apart: the same objects masked and unmasked."""

from pathlib import Path

import numpy as np
import torch

from training.small_models.clip_evaluation import Exam, table_of_kinds
from training.small_models.clip_model import build, write_description
from training.small_models.patches import PATCH_PX
from training.tests.test_clip_training import crops_of


def test_an_unmasked_exam_sees_the_background(tmp_path: Path) -> None:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    names = np.array(["cup", "couch", "wall"] * 4)
    count = len(names)
    patches = rng.integers(0, 256, (count, PATCH_PX, PATCH_PX, 4), dtype=np.uint8)
    patches[..., 3] = 0
    # The first half has masks that fill their squares, so a mask changes nothing.
    patches[:6, 4:68, 4:68, 3] = 255
    patches[6:, 4:68, 30:42, 3] = 255
    crops = crops_of(names, rng, patches, "plain cloth:1.00")
    write_description(tmp_path)
    model, tokenizer = build(tmp_path)
    exams = {
        kind: Exam(model.eval(), tokenizer, crops, masked)
        for kind, masked in (("masked crop", True), ("unmasked square", False))
    }
    masked, square = (exam.features for exam in exams.values())
    torch.testing.assert_close(masked[:6], square[:6], atol=1e-5, rtol=0)
    assert ((masked[6:] - square[6:]).abs().amax(dim=1) > 1e-3).all()
    scores = table_of_kinds(exams)
    assert list(scores) == list(exams)
    assert scores["unmasked square"]["category, top 1"].count == 8
    assert scores["unmasked square"]["piece of the building"].count == 4
