"""What tables of finished scenes share."""

from pathlib import Path

import pytest

from benchmarks.common import scene_name


@pytest.mark.parametrize(
    "folder, name",
    [
        ("results/adt/scene1", "adt/scene1"),
        ("/elsewhere/results/adt/scene1/", "adt/scene1"),
        ("results/adt/scene1/variants/draft", "adt/scene1/variants/draft"),
        ("results/adt/scene2/variants/draft", "adt/scene2/variants/draft"),
    ],
)
def test_a_scene_and_its_variants_have_a_name_of_their_own(folder, name):
    assert scene_name(Path(folder)) == name
