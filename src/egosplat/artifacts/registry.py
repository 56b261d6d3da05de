"""The schemas of all kinds of artifacts."""

from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import (
    ANNOTATIONS,
    FEATURES,
    FRAMES,
    HISTORIES,
    INSTANCES,
    LANGUAGE,
    MASKS,
    POSES,
    SEGMENTS,
    SPLATS,
    TRANSIENT,
    VIEW_FEATURES,
)
from egosplat.artifacts.tiles import TILES

_ALL = (
    FRAMES,
    ANNOTATIONS,
    POSES,
    TRANSIENT,
    SEGMENTS,
    INSTANCES,
    VIEW_FEATURES,
    FEATURES,
    MASKS,
    SPLATS,
    TILES,
    LANGUAGE,
    HISTORIES,
)
# Every kind of artifact, by name.
SCHEMAS: dict[str, Schema] = {schema.name: schema for schema in _ALL}
