"""Benchmarks of models and of merging run at their smallest size."""

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from benchmarks.instances import growth
from benchmarks.published_weights import save_clip
from egosplat.language.decoder import Decoder
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.pipeline.model_sets import CATALOGUE
from egosplat.query.contest import Contest
from egosplat.query.grades import AMONG_WORDS
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene


def run(command, *words) -> str:
    done = CliRunner().invoke(command, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_made_up_masks_are_merged_to_the_instances_they_show():
    frames, gaussians, masks, _, instances, *_ = run(growth.main, "--one", 12, 3000, 0).strip().split("|")
    assert (frames, gaussians) == ("12", "3,000")
    assert 0 < int(instances) <= growth.INSTANCES < int(masks)


@pytest.mark.slow
@pytest.mark.parametrize("name", [one.architecture for one in CATALOGUE if one.library == "OpenCLIP"])
def test_random_weights_of_published_architectures_find_nothing(name, tmp_path):
    torch.manual_seed(0)
    save_clip(tmp_path / "clip.pt", name)
    clip = load_open_clip(name, str(tmp_path / "clip.pt"), "cpu", "float32")
    clip.model.logit_scale.fill_(np.log(100.0))  # trained weights have this scale, random ones 14
    pictures = torch.nn.functional.interpolate(torch.randn(8, 3, 14, 14), clip.model.visual.image_size)
    with torch.inference_mode():
        code = torch.nn.functional.normalize(clip.model.encode_image(pictures))[:, None]
    decoder = Decoder((code.shape[-1],), np.zeros(0, np.float32))
    scene = QueryScene(None, None, None, 0, code, torch.ones(len(code), 1), decoder, ["whole"])
    contest = Contest(scene, clip, QueryOptions())
    asked = contest.words.phrases[::20]
    assert len(asked) > 50 and max(contest.best(contest.words.of([one])) for one in asked) < AMONG_WORDS.guess
