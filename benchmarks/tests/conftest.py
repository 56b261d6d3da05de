"""Fixtures of the other tests that measurements use, too."""

from tests.conftest import number_of_threads, real_data  # noqa: F401
from tests.support.pretended_gpu import gpu  # noqa: F401
from tests.unit.conftest import couch_and_cup, halves, tiny_clip, word_scene, word_scene_in  # noqa: F401
from tests.unit.models.conftest import tiny_sam2  # noqa: F401
