"""The schemas of all kinds of artifacts."""

from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.carries import CARRIES
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.masks import MASKS
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.rests import RESTS
from egosplat.artifacts.schema import Schema
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.artifacts.tiles import TILES
from egosplat.artifacts.transient import TRANSIENT
from egosplat.artifacts.view_features import VIEW_FEATURES

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
