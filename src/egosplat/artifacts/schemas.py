"""The schemas of artifacts, and what stages read from several of them. A stage that imports one of these is
stale when that one changes, not when another does (``pipeline.code_hash``): a definition stands below those
that it needs."""

import numpy as np

from egosplat.arrays import Array, Bools
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schema import Schema, read_table

# ``frames.zarr``: the frames of a recording, and how they lie.
FRAMES = read_table("frames")


def shown_pixels(frames: Artifact, index: int, valid: Bools) -> Bools:
    """(H, W) bool: the pixels of a frame that show the scene; ``valid`` is the array of this name."""
    return valid & ~frames.row("masked", index) if frames.has("masked") else valid


def seconds_of(frames: Artifact) -> Array:
    """(F,) time of each frame since the first [s]."""
    times = frames.read("timestamp_ns")
    return (times - times[:1]) / 1e9


def lies_on_its_side(frames: Artifact) -> bool:
    """Whether images lie on their side, as from Aria's sensor (docs/method.md#upright)."""
    # OpenCLIP and the transient network need upright images: they are turned clockwise.
    return frames.facts["format"] == "adt" and not frames.facts["upright"]


# ``annotations.zarr``: instance maps of the evaluation frames. For evaluation only.
ANNOTATIONS = read_table("annotations")

# ``poses.zarr``: camera poses and points.
POSES = read_table("poses")


def length_unit(poses: Artifact) -> str:
    """The unit of lengths in the scene's world: ``m``, or ``scene units`` where COLMAP's scale is arbitrary."""
    return "scene units" if poses.facts.get("notes", {}).get("scale") == "arbitrary" else "m"


# ``transient.zarr``: the probability that a pixel is transient, and its mean over instances.
TRANSIENT = read_table("transient")

# ``segments.zarr``: instances at up to three levels, tracked through the video.
SEGMENTS = read_table("segments")

# Value of the fact ``source``: the tracks of segments.zarr, unchanged.
TRACKS = "tracks"

# ``instances.zarr``: things that hold in 3D, or the tracks of segments.zarr unchanged.
INSTANCES = read_table("instances")


def is_track(instances: Artifact) -> Bools:
    """(N,) the instances that are tracks; the others are masks that are merged in 3D."""
    moving = instances.read("instances/moving")
    return np.ones_like(moving) if instances.facts["source"] == TRACKS else moving


# ``view_features.zarr``: the feature of each instance in each frame that shows it.
VIEW_FEATURES = read_table("view_features")

# ``features.zarr``: aggregated features of instances, supervision of views, codes, decoder.
FEATURES = read_table("features")

# Why nothing is masked, in the fact ``withheld``.
BY_NETWORK, BY_INSTANCES = "probability", "instances"

# ``masks.zarr``: the transient instances, and the pixels that training masks.
MASKS = read_table("masks")

# Values of ``corrections/source``.
AS_GIVEN, TRAINED, FITTED, INTERPOLATED = range(4)

# ``splats.zarr``: trained Gaussians, training curves, and renders of held-out frames.
SPLATS = read_table("splats")


def camera_poses(poses: Artifact, splats: Artifact) -> Array:
    """(F, 4, 4) float64 poses to render with, those of training where it refined them; NaN where not registered."""
    corrected = splats.has("corrections/camera_to_world")
    return splats.read("corrections/camera_to_world") if corrected else poses.read("camera_to_world")


# ``tiles.zarr``: OpenCLIP features of the tiles of each training frame, at scales of which the first has the smallest tiles.
TILE_SCALES = [f"scale/{number}" for number in range(7)]
TILES = read_table("tiles")

# ``language.zarr``: a code for each Gaussian of ``splats.zarr`` and each level.
LANGUAGE = read_table("language")

# ``histories.zarr``: things that leave a place and are put down at another (``carries``), Gaussians of those that lie somewhere
# for a while (``rests``), and which of both are of one thing.
HISTORIES = read_table("histories")

# Every kind of artifact, by name.
_ALL = (FRAMES, ANNOTATIONS, POSES, TRANSIENT, SEGMENTS, INSTANCES, VIEW_FEATURES, FEATURES, MASKS)
SCHEMAS: dict[str, Schema] = {schema.name: schema for schema in (*_ALL, SPLATS, TILES, LANGUAGE, HISTORIES)}
