"""The views of the unit tests of the stage."""

from tests.unit.transient.conftest import pictures, views

__all__ = ["pictures", "views"]
