"""Warnings about small checkpoints on real recordings."""

import json

import pytest

from egosplat.doctor.inputs import scene_notice
from egosplat.pipeline import config as configuration
from egosplat.pipeline.scenes import Scene

DEFAULTS = configuration.defaults()
PUBLISHED = configuration.merge(DEFAULTS, {"models": {"sam2_checkpoint": "a", "clip_checkpoint": "b"}})


@pytest.mark.parametrize(
    "format, recording, synthetic, config, warned",
    [
        ("plain", "video.mp4", False, DEFAULTS, True),
        ("plain", "absent.mp4", False, DEFAULTS, False),
        ("plain", "video.mp4", False, PUBLISHED, False),
        ("adt", "recording", True, DEFAULTS, False),
        ("adt", "sequence", False, DEFAULTS, False),
    ],
    ids=["real", "absent", "published models", "synthetic", "synthetic by its metadata"],
)
def test_the_small_checkpoints_are_warned_of_on_real_recordings(
    tmp_path, format, recording, synthetic, config, warned
):
    (tmp_path / "video.mp4").touch()
    (tmp_path / "sequence").mkdir()
    (tmp_path / "sequence/metadata.json").write_text(json.dumps({"origin": "synthetic"}))
    notice = scene_notice(Scene("mine", "a", format, tmp_path / recording, synthetic, config))
    assert (notice is not None) == warned and "\n" not in (notice or "")
