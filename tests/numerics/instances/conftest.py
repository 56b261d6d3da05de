"""The wall of two squares, as in the unit tests of the stage."""

from tests.unit.instances.conftest import scene, truth

__all__ = ["scene", "truth"]
