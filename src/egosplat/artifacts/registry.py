"""The schemas of all kinds of artifacts."""

from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.rests import RESTS
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.schemas import (
    ANNOTATIONS,
    FEATURES,
    FRAMES,
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
    CARRIES,
    RESTS,
)
# Every kind of artifact, by name.
SCHEMAS: dict[str, Schema] = {schema.name: schema for schema in _ALL}
