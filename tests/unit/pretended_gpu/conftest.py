"""The small scenes of other tests, and a pretended GPU."""

import pytest

from tests.support.pretended_gpu import pretended_gpu
from tests.unit.language.conftest import camera_to_world, labels, scene, wall
from tests.unit.segments.conftest import sam2

__all__ = ["camera_to_world", "labels", "sam2", "scene", "wall"]


@pytest.fixture
def gpu(monkeypatch):
    """The pretended GPU, for the rest of the test; no test may mix its tensors with those of the CPU."""
    with pretended_gpu(monkeypatch) as device:
        yield device
    assert not device.mixed
