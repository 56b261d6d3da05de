"""Fixtures of methods of others: the scenes of the rooms whose results they replace."""

from tests.unit.evaluation.conftest import annotations, instance_map, instances
from tests.unit.features.conftest import clip_keys, labels, scene, tiny_clip

__all__ = ("annotations", "clip_keys", "instance_map", "instances", "labels", "scene", "tiny_clip")
