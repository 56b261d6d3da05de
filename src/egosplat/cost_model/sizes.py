"""The sizes of a scene on which memory and time of its stages depend."""

import errno
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from egosplat.errors import UserError
from egosplat.models.configs import SMALL, sam2_side
from egosplat.pipeline.config import DEPTH, Config
from egosplat.pipeline.dag import prompts_by_depth, segments_single_frames, tracks_what_moves

# Levels of instances.
LEVELS = 3

# Side of the square to which the small and the published SAM2 resize frames [px].
SMALL_SIDE, SAM2_SIDE = 320, 1024

# Of a furnished apartment, all levels together. Instances that SAM2 tracks: 134 in adt/scene1. On average over adt/scene1 to
# adt/scene5 with a real camera: tracks that move, masks of one frame, instances that masks are merged into, the share of the
# frames that show each, and the temporary Gaussians that they are merged on.
TYPICAL_TRACKED, TYPICAL_MOVING, TYPICAL_MASKS, TYPICAL_MERGED, MERGED_SEEN = 150, 20, 86, 400, 0.2
MERGING_GAUSSIANS = 60_000

# Points of a frame where segments.point_prompts is depth (docs/methods.md).
PROMPTS_BY_DEPTH = 1720

# Assumed frames of a recording that is not read yet: two minutes at ADT's 30 frames per second.
UNKNOWN_FRAMES = 3600

# Pixels of a recorded frame; ADT's. No artifact stores the recording's own size.
RECORDED_PIXELS = 1408**2

# The laws were fitted to pictures of the temporary Gaussians with at most so many pixels.
LARGE_PIXELS = 512**2

# Bytes for each pixel of the array that ``splats.masking`` reads; ``auto`` may read refined masks.
MASK_BYTES = {"none": 0, "initial": 2, "refined": 1, "auto": 1}

# By size: the artifacts that have it, the array, and the axes whose product it is.
_IN_ARTIFACTS: dict[str, tuple[tuple[str, str, slice], ...]] = {
    "frames": (("frames", "rgb", slice(0, 1)), ("instances", "labels", slice(0, 1))),
    "pixels": (("frames", "rgb", slice(1, 3)), ("instances", "labels", slice(2, 4))),
    "points": (("poses", "points/xyz", slice(0, 1)),),
    "instances": (("instances", "instances/level", slice(0, 1)),),
    "views": (("view_features", "feature", slice(0, 1)), ("features", "instance", slice(0, 1))),
    "channels": (("view_features", "feature", slice(1, 2)),),
    "dims": (("features", "code", slice(1, 2)),),
    "gaussians": (("splats", "means", slice(0, 1)),),
}


class Sizes(Mapping[str, float]):
    """The sizes of a scene by name: those given, else those in the headers of a job's inputs, else the configuration's.

    A header is a JSON file of 1 kB; it is read only when a size in it is requested.

    Args:
        inputs: paths of a job's inputs; files that are no artifacts are ignored.
        given: sizes from elsewhere, which take precedence.
        at_most: whether an unknown number of instances is the limit of the configuration
            (``segments.max_instances``) or a typical number.

    Raises:
        FileNotFoundError: (on access) the input with the size does not exist yet; ``filename`` is its path.
        LookupError: (on access) neither an input nor the configuration has the size.
    """

    def __init__(
        self,
        config: Config,
        inputs: Iterable[str] = (),
        given: Mapping[str, float] | None = None,
        at_most: bool = False,
    ) -> None:
        self._config = config
        self._paths = {Path(path).stem: path for path in inputs if Path(path).suffix == ".zarr"}
        self._given = given or {}
        self._at_most = at_most

    def __getitem__(self, name: str) -> float:
        if name in self._given:
            return self._given[name]
        for artifact, array, axes in _IN_ARTIFACTS.get(name, ()):
            if artifact in self._paths:
                shape = _header(self._paths[artifact], array)["shape"]
                return math.prod(shape[axes])
        if name in _FROM_CONFIG:
            return _FROM_CONFIG[name](self._config, self)
        raise LookupError(f"no input of the job has its {name}: {', '.join(self._paths) or 'none'}")

    def __iter__(self) -> Iterator[str]:
        return iter({**_IN_ARTIFACTS, **_FROM_CONFIG, **self._given})

    def __len__(self) -> int:
        return len(list(iter(self)))

    def limited(self, typical: int) -> int:
        """A number of tracks of all levels: the typical one, or the most that the configuration allows."""
        allowed = LEVELS * self._config["segments"]["max_instances"]
        return allowed if self._at_most else min(typical, allowed)

    @property
    def colmap(self) -> bool:
        """Whether COLMAP finds the poses of these frames.

        Raises:
            FileNotFoundError: the frames artifact does not exist yet.
        """
        if self._config["poses"]["method"] == "colmap":
            return True
        if "frames" not in self._paths:
            return False
        facts = _header(self._paths["frames"], "")["attributes"]["egosplat"]["facts"]
        return facts["device_from_camera"] is None


def _header(path: str, array: str) -> dict[str, Any]:
    try:
        return json.loads((Path(path) / array / "zarr.json").read_text())
    except OSError:
        raise FileNotFoundError(errno.ENOENT, "is still to be made", path) from None


def _evaluated(config: Config, sizes: Sizes) -> float:
    count = config["frames"]["evaluation_frames"]
    return 12 if count == "auto" else count


def images_of_a_frame(segments: Mapping[str, Any], area: float) -> float:
    """Images of SAM2's own size that a frame counts as where it is searched: the whole frame, and its crops.

    Args:
        segments: keys of the section; recorded ones may be older than ``point_prompts``.
        area: of the whole frame as SAM2 sees it, as a multiple of its own.
    """
    side = segments["crops_per_side"]
    return area + (side**2 if side > 1 and segments.get("point_prompts") != DEPTH else 0)


def _searched(config: Config, sizes: Sizes) -> float:
    """Frames that are searched for instances."""
    keys = config["segments"]
    return 1 if keys["prompting"] == "initial_frame" else 1 + sizes["kept"] / keys["key_frame_stride"]


def _images(config: Config, sizes: Sizes) -> float:
    """Images that SAM2 encodes: every frame that is tracked through, or the frames that are searched, with their crops."""
    if segments_single_frames(config):
        return _searched(config, sizes) * images_of_a_frame(config["segments"], _area(config))
    return sizes["kept"] * sizes["sam2_area"]


def _prompts(config: Config, sizes: Sizes) -> float:
    """Points in each image that is searched: those of a grid, or as many as depth asks for."""
    searched = sizes["images"] if segments_single_frames(config) else _searched(config, sizes)
    points = PROMPTS_BY_DEPTH if prompts_by_depth(config) else config["segments"]["points_per_side"] ** 2
    return searched * points


def _labelled(config: Config, sizes: Sizes) -> float:
    return _searched(config, sizes) if segments_single_frames(config) else sizes["kept"]


def _moving(config: Config, sizes: Sizes) -> int:
    """Tracks beside the masks of single frames."""
    return sizes.limited(TYPICAL_MOVING) if tracks_what_moves(config) else 0


def _tracked(config: Config, sizes: Sizes) -> int:
    return _moving(config, sizes) if segments_single_frames(config) else sizes.limited(TYPICAL_TRACKED)


def merges_masks(config: Config) -> bool:
    """Whether masks are merged into instances; else each track, or mask of a frame, is one."""
    source = config["instances"]["source"]
    return segments_single_frames(config) if source == "auto" else source != "tracks"


def _masks(config: Config, sizes: Sizes) -> float:
    return TYPICAL_MASKS * sizes["labelled"] * merges_masks(config)


def _instances(config: Config, sizes: Sizes) -> float:
    if merges_masks(config):
        return TYPICAL_MERGED
    if segments_single_frames(config):
        return TYPICAL_MASKS * sizes["labelled"]
    return sizes["tracked"] / 2  # 72 of 134 in adt/scene1


def _views(config: Config, sizes: Sizes) -> float:
    """A track is seen in half of the frames, 0.55 in adt/scene1; a mask of a single frame in that one."""
    seen = sizes["frames"] * (MERGED_SEEN if merges_masks(config) else 0.5)
    if segments_single_frames(config) and not merges_masks(config):
        seen = 1.0
    return sizes["instances"] * min(seen, config["view_features"]["max_views"] or seen)


def _dims(config: Config, sizes: Sizes) -> float:
    dims = config["features"]["dims"]
    if config["features"]["compression"] == "none":
        return sizes["channels"]
    # "auto" chose 38 to 42 of the bundled OpenCLIP's 128.
    return sizes["channels"] / 3 if dims == "auto" else dims


def _sam2_area(config: Config, _: Sizes) -> float:
    """Pixels of the images that are tracked, as a multiple of the architecture's own."""
    return 1.0 if segments_single_frames(config) else _area(config)


def _area(config: Config) -> float:
    """Pixels of whole frames as SAM2 sees them, as a multiple of the architecture's own."""
    own = SMALL_SIDE if config["models"]["sam2_config"] == SMALL else SAM2_SIDE
    try:
        side = config["segments"]["image_size"] or sam2_side(config["models"]["sam2_config"])
    except UserError:  # the stage itself reports it
        side = own
    return (side / own) ** 2


def _corrected(config: Config, _: Sizes) -> float:
    """1 if the training corrects the camera, or if the survey may decide so."""
    return float(set(config["camera"].values()) != {"off"})


def _network_iterations(config: Config, _: Sizes) -> float:
    keys = config["transient"]
    return keys["iterations"] - round(keys["warmup"] * keys["iterations"])


def _autoencoder(config: Config, _: Sizes) -> float:
    return float(config["features"]["compression"] == "autoencoder")


def _filmed(config: Config, _: Sizes) -> float:
    """Frames of a synthetic recording; a blurred one counts as several (docs/real_camera.md#how-it-is-rendered)."""
    keys = config["synthetic"]
    exposure = keys["exposure_ms"]
    blurred = keys["camera"] == "real" if exposure == "auto" else exposure > 0
    return keys["seconds"] * keys["fps"] * (3.3 if blurred and keys["camera_strength"] else 1)


# By size: its value if no input has it.
_FROM_CONFIG: dict[str, Callable[[Config, Sizes], float]] = {
    # The recording. Frames that the survey drops, and those that are evaluated, count as kept and trained on.
    "recorded_pixels": lambda config, _: RECORDED_PIXELS,
    "filmed_frames": _filmed,
    "filmed_pixels": lambda config, _: config["synthetic"]["size"] ** 2,
    "kept": lambda _, sizes: sizes["frames"],
    "training": lambda _, sizes: sizes["frames"],
    "pairs": lambda _, sizes: sizes["frames"],
    "surveyed_pixels": lambda _, sizes: min(sizes["pixels"], 256**2),  # egosplat.survey.motion.SIDE
    "evaluated": _evaluated,
    "points": lambda *_: 1_000_000,
    # Instances and their features.
    "images": _images,
    "prompts": _prompts,
    "tracked": _tracked,
    "moving": _moving,
    "labelled": _labelled,
    "masks": _masks,
    # Runs that stay to the last merge grow with the square root of the masks (benchmarks/instances).
    "runs": lambda _, sizes: math.sqrt(sizes["masks"]),
    "instances": _instances,
    "merging_iterations": lambda config, _: config["instances"]["iterations"] * merges_masks(config),
    "merging_pixels": lambda config, sizes: (
        min(config["instances"]["resolution"] ** 2, sizes["pixels"]) * merges_masks(config)
    ),
    "merging_gaussians": lambda config, _: MERGING_GAUSSIANS * merges_masks(config),
    "merged_views": lambda config, sizes: sizes["views"] * merges_masks(config),
    "sam2_area": _sam2_area,
    "views": _views,
    "shown": lambda _, sizes: sizes["views"] / sizes["kept"],
    "channels": lambda config, _: 128 if config["models"]["clip_model"] == SMALL else 512,
    "dims": _dims,
    "codes": lambda _, sizes: LEVELS * sizes["dims"],
    "autoencoder": _autoencoder,
    "epochs": lambda config, _: config["features"]["epochs"] * _autoencoder(config, _),
    "queries": lambda *_: 150,
    # The transient network and its temporary Gaussians.
    "initial_iterations": lambda config, _: config["transient"]["iterations"],
    "network_iterations": _network_iterations,
    "initial_pixels": lambda config, sizes: min(config["transient"]["resolution"] ** 2, sizes["pixels"]),
    "large_initial_pixels": lambda _, sizes: max(0, sizes["initial_pixels"] - LARGE_PIXELS),
    "network_pixels": lambda config, _: config["transient"]["input_size"] ** 2,
    "initial_gaussians": lambda config, _: config["transient"]["max_gaussians"],
    # Gaussians; density control reaches its budget.
    "iterations": lambda config, _: config["splats"]["iterations"],
    "gaussians": lambda config, _: config["splats"]["max_gaussians"],
    "mean_gaussians": lambda _, sizes: sizes["gaussians"],
    "corrected": _corrected,
    "mask_bytes": lambda config, _: MASK_BYTES[config["splats"]["masking"]],
    "joint": lambda config, sizes: sizes["codes"] if config["splats"]["language"] == "joint" else 0,
    "language_iterations": lambda config, _: config["language"]["iterations"],
    "sampled": lambda config, _: config["language"]["pixels"],
}
