"""Memory, time and GPUs that a stage's job requests: a row of one table, times the sizes of the scene, times the attempt."""

import errno
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from egosplat.pipeline.chunks import CHUNK_FRAMES
from egosplat.pipeline.config import Config, stage_values
from egosplat.pipeline.dag import (
    merges_masks,
    merges_on_splats,
    prompts_by_depth,
    segments_single_frames,
    takes_splat,
)

# Levels of instances.
_LEVELS = 3

# Of a furnished apartment, all levels together: instances that masks are merged into, and masks of a frame.
_MERGED, _MASKS = 400, 86

# Frames of a recording that is not read yet: two minutes of 30 frames per second.
UNREAD_FRAMES = 3600

# Of the memory in which Gaussians are trained, what pictures and masks take at most; others are read from the disk [MB].
_HELD_MB = 3221

# Factor of the memory. On the largest finished scene stages took up to 1.1 times what was expected.
_MEMORY_MARGIN = 1.3

# Memory of the two Snakemake processes of a job [MB], and of CUDA's libraries in one that uses a GPU (assumed).
_SNAKEMAKE_MB, _CUDA_MB = 700, 3000

# Factor of the time, and start of a job [min]: kernels without AVX take three times as long, machines and file systems are
# busy. A stage that is stopped after a day resumes from its checkpoint.
_TIME_MARGIN, _START_MIN, _DAY_MIN = 10, 10, 1440

# Speed of the published models on a GPU against two cores. Assumed.
_GPU_SPEEDUP = 150

_ON_GPU = {"auto", "cuda"}
_SMALL, _PHOTOS = "small", "photos"

# Channels of features by models.clip_model; others have about 512.
_CHANNELS = {_SMALL: 128, _PHOTOS: 1000}


class Cost(NamedTuple):
    """What a stage takes.

    Attributes:
        base_mb: main memory of the smallest scene, without a GPU [MB].
        mb: more memory for each unit [MB]. A unit is a size (see ``Sizes``) or a product of sizes.
        minutes: time for each unit, on two cores with AVX-512 and without a GPU [min].
    """

    base_mb: float
    mb: Mapping[str, float]
    minutes: Mapping[str, float]


_TRAINED_ON_SAMPLES = {"gaussians": 9290}

# Fitted to runs of small and full apartments on two cores, of up to 120 frames of 1408 x 1408; memory is rounded up. The
# published models, COLMAP and the methods of others were measured in single runs.
COSTS: dict[str, Cost] = {
    "synthetic": Cost(350, {"megapixels": 1151}, {"video": 0.02}),
    "frames": Cost(300, {"megapixels": 40}, {"video": 0.0005}),
    "annotations": Cost(325, {"megapixels": 46}, {}),
    "poses": Cost(265, {"frames": 0.031}, {}),
    "poses_colmap": Cost(3000, {"megapixels": 3201, "frames": 4.2}, {"video": 0.18}),
    "survey": Cost(135, {"megapixels": 200}, {"frames": 0.0013}),
    "segments": Cost(
        805, {"tracks": 3, "megapixels": 325, "video": 0.13}, {"prompts": 0.036, "frames": 0.0045}
    ),
    "segments_tracked": Cost(
        805, {"tracks": 7.6, "megapixels": 325, "video": 0.13}, {"prompts": 0.036, "frames": 0.06}
    ),
    "segments_classical": Cost(875, {"megapixels": 200}, {"frames": 0.05}),
    "segments_published": Cost(
        1955, {"tracks": 20.2, "megapixels": 325, "video": 0.13}, {"prompts": 1.0, "frames": 1.0}
    ),
    "segments_published_tracked": Cost(
        1955, {"tracks": 20.2, "megapixels": 325, "video": 0.13}, {"prompts": 0.7, "frames": 7.1}
    ),
    "instances": Cost(
        1020, {"searched": 8.9, "megapixels": 69}, {"iterations": 0.4, "searched": 0.02, "video": 0.0015}
    ),
    "view_features": Cost(730, {"features": 16.1, "megapixels": 38}, {"frames": 0.0011}),
    "view_features_published": Cost(2020, {"features": 16.1, "megapixels": 38}, {"frames": 0.5}),
    "view_features_photos": Cost(1080, {"features": 16.1, "megapixels": 38}, {"frames": 0.05}),
    "features": Cost(760, {"features": 53.2}, {"features": 0.5}),
    "transient": Cost(
        1000,
        {"video": 3, "megapixels": 700, "gaussians": 530},
        {"iterations": 0.6, "iterations*megapixels": 1.9, "iterations*gaussians": 3.5},
    ),
    "masks": Cost(62, {"megapixels": 123}, {"video": 0.0014}),
    "splats": Cost(
        620,
        {"video": 5, "megapixels": 400, "gaussians": 3090, "megapixels*joint": 63},
        {
            "iterations": 0.1,
            "iterations*megapixels": 0.8,
            "iterations*gaussians": 4.1,
            "iterations*megapixels*joint": 0.2,
        },
    ),
    "language": Cost(
        630,
        {"megapixels": 1180, "gaussians": 845, "gaussians*codes": 12.1},
        {"frames*gaussians": 0.03},
    ),
    "carries": Cost(600, {"gaussians": 1001}, {"frames*gaussians": 0.006}),
    "rests": Cost(1100, {"gaussians": 1001}, {"frames*gaussians": 0.05}),
    "rests_published": Cost(2390, {"gaussians": 1001}, {"frames*gaussians": 0.05, "frames": 0.02}),
    "language_center": Cost(690, {"gaussians*codes": 18.7}, {"frames*gaussians*codes": 0.0001}),
    "language_clustered": Cost(690, {"gaussians*codes": 52.3}, {"frames*gaussians*codes": 0.0007}),
    "language_trained": Cost(
        690,
        {"megapixels*codes": 8.1, "gaussians": 4010, "gaussians*codes": 16.1},
        {"iterations*megapixels*codes": 0.85},
    ),
    "language_sparse": Cost(690, _TRAINED_ON_SAMPLES, {"iterations*sampled": 0.22}),
    "language_granular": Cost(690, _TRAINED_ON_SAMPLES, {"iterations*sampled": 1.2}),
    "metrics": Cost(760, {"megapixels": 296, "gaussians": 3431}, {"megapixels": 0.15, "gaussians": 1.0}),
    "metrics_published": Cost(
        2050, {"megapixels": 296, "gaussians": 3431}, {"megapixels": 0.15, "gaussians": 1.0}
    ),
    "sheet": Cost(351, {"megapixels": 300}, {"": 2.0}),
    "sheet_of_renders": Cost(1201, {"gaussians": 1001}, {"": 2.0}),
}

# Stages, or values of language.method, that take what another takes.
_LIKE = {
    **dict.fromkeys(("contact_sheet", "instances_sheet", "crops_sheet", "splats_sheet"), "sheet"),
    **dict.fromkeys(("transient_sheet", "language_sheet"), "sheet_of_renders"),
    "carries_sheet": "sheet",
    "language_lifted": "language",
    "language_projected": "language_center",
    "language_quantized": "language_sparse",
    "language_field": "language_granular",
    "queries_sheet": "metrics",  # answers the same queries
}

# By size: the artifacts that have it, the array, and the axes whose product it is.
_IN_ARTIFACTS: dict[str, tuple[tuple[str, str, slice], ...]] = {
    "frames": (("frames", "rgb", slice(0, 1)), ("instances", "labels", slice(0, 1))),
    "pixels": (("frames", "rgb", slice(1, 3)), ("instances", "labels", slice(2, 4))),
    "instances": (("instances", "instances/level", slice(0, 1)),),
    "gaussians": (("splats", "means", slice(0, 1)),),
    "numbers": (("view_features", "feature", slice(0, 2)),),
}


class Sizes:
    """The sizes of a job: from the headers of its inputs, one JSON file of 1 kB each, else from the configuration.

    Args:
        inputs: paths of the job's inputs; files that are no artifacts are ignored.
        frames: number of frames where no input has it.
        chunk: whether the job works on a chunk of the frames alone.

    Raises:
        FileNotFoundError: (on access) the input with the size does not exist yet; ``filename`` is its path.
        LookupError: (on access) neither an input nor the configuration has the size.
    """

    def __init__(
        self,
        stage: str,
        config: Config,
        inputs: Iterable[str] = (),
        frames: float | None = None,
        *,
        chunk: bool = False,
    ) -> None:
        # The job that reads a recording has no input with its length.
        frames = UNREAD_FRAMES if frames is None and stage == "frames" else frames
        self._stage, self._config, self._frames, self._chunk = stage, config, frames, chunk
        self._paths = {Path(path).stem: path for path in inputs if Path(path).suffix == ".zarr"}
        self._gathers = any(path.endswith(".chunk") for path in inputs)

    def times(self, unit: str) -> float:
        """How many of a unit there are."""
        return math.prod(getattr(self, name) for name in unit.split("*") if name)

    @property
    def frames(self) -> float:
        """Frames of the scene, or of a synthetic recording."""
        if self._stage == "synthetic":
            return self._config["synthetic"]["seconds"] * self._config["synthetic"]["fps"]
        frames = self._read("frames", self._frames)
        return min(frames, CHUNK_FRAMES) if self._chunk else frames

    @property
    def megapixels(self) -> float:
        """Pixels of a frame [millions]; in ``transient`` of the pictures that it trains on."""
        if self._stage == "synthetic":
            return self._config["synthetic"]["size"] ** 2 / 1e6
        own = None if self._frames is None else self._config["frames"]["resolution"] ** 2
        pixels = self._read("pixels", own)
        if self._stage == "transient":
            pixels = min(pixels, self._config["transient"]["resolution"] ** 2)
        return pixels / 1e6

    @property
    def video(self) -> float:
        """Pixels of all frames [millions]."""
        return self.frames * self.megapixels

    @property
    def searched(self) -> float:
        """Frames that are searched for instances."""
        keys = self._config["segments"]
        return 1 + (0 if keys["prompting"] == "initial_frame" else self.frames / keys["key_frame_stride"])

    @property
    def prompts(self) -> float:
        """Point prompts of SAM2 [thousands]. Depth asks for about 1,720 in a frame, a grid for as many in each crop, too."""
        if self._gathers:
            return 0
        keys = self._config["segments"]
        if prompts_by_depth(self._config):
            return self.searched * 1.72
        crops = keys["crops_per_side"] ** 2 if keys["crops_per_side"] > 1 else 0
        return self.searched * (1 + crops) * keys["points_per_side"] ** 2 / 1000

    @property
    def tracks(self) -> float:
        """The most instances that SAM2 tracks, at all levels."""
        return _LEVELS * self._config["segments"]["max_instances"]

    @property
    def features(self) -> float:
        """Numbers in the features of all views of instances [millions]."""
        if self._stage == "features" and "view_features" in self._paths:
            return self._read("numbers") / 1e6
        if not segments_single_frames(self._config):
            views = self._read("instances", self.tracks / 2) * self.frames / 2
        elif self._config["instances"]["source"] == "tracks":
            views = _MASKS * self.searched
        else:
            views = self._read("instances", _MERGED) * self.frames / 5
        return views * self._channels / 1e6

    @property
    def gaussians(self) -> float:
        """The most Gaussians that are trained [millions]."""
        section = "transient" if self._stage == "transient" else "splats"
        most = self._config[section]["max_gaussians"]
        # A limit of training does not hold for Gaussians of another program.
        given = section == "splats" and takes_splat(self._config)
        return (self._read("gaussians", most) if given else most) / 1e6

    @property
    def codes(self) -> float:
        """Numbers in a code, all levels together."""
        keys = self._config["features"]
        whole = keys["compression"] == "none"
        # ``auto`` chose 38 to 42 of the bundled OpenCLIP's 128.
        dims = self._channels if whole else self._channels / 3 if keys["dims"] == "auto" else keys["dims"]
        return _LEVELS * dims

    @property
    def joint(self) -> float:
        """Numbers in a code if codes are trained with the geometry, else 0."""
        return self.codes if self._config["splats"]["language"] == "joint" else 0

    @property
    def iterations(self) -> float:
        """Training iterations of the stage [thousands]; instances need none for tracks or on the scene's Gaussians."""
        own = merges_masks(self._config) and not merges_on_splats(self._config)
        if self._stage == "instances" and not own:
            return 0
        return self._config[self._stage]["iterations"] / 1000

    @property
    def sampled(self) -> float:
        """Pixels that an iteration of ``language`` samples [thousands]."""
        return self._config["language"]["pixels"] / 1000

    @property
    def colmap(self) -> bool:
        """Whether COLMAP finds the poses."""
        if self._config["poses"]["method"] == "colmap":
            return True
        if "frames" not in self._paths:
            return False
        facts = _header(self._paths["frames"], "")["attributes"]["egosplat"]["facts"]
        return facts["device_from_camera"] is None

    @property
    def _channels(self) -> int:
        return _CHANNELS.get(self._config["models"]["clip_model"], 512)

    def _read(self, name: str, default: float | None = None) -> float:
        for artifact, array, axes in _IN_ARTIFACTS[name]:
            if artifact in self._paths:
                return math.prod(_header(self._paths[artifact], array)["shape"][axes])
        if default is None:
            raise LookupError(f"no input of the job has its {name}: {', '.join(self._paths) or 'none'}")
        return default


def _header(path: str, array: str) -> dict[str, Any]:
    try:
        return json.loads((Path(path) / array / "zarr.json").read_text())
    except OSError:
        raise FileNotFoundError(errno.ENOENT, "is still to be made", path) from None


def cost_of(stage: str, config: Config, sizes: Sizes) -> Cost:
    """The row of a stage under a configuration (KeyError: the stage has none)."""
    models = config["models"]
    row = _LIKE.get(stage, stage)
    if stage == "poses" and sizes.colmap:
        row = "poses_colmap"
    elif stage == "segments" and config["segments"]["segmenter"] == "classical":
        row = "segments_classical"
    elif stage == "segments":
        row += "" if models["sam2_config"] == _SMALL else "_published"
        row += "" if segments_single_frames(config) else "_tracked"
    elif stage == "language" and config["splats"]["language"] != "joint":
        method = f"language_{config['language']['method']}"
        row = _LIKE.get(method, method)
    elif row == "view_features" and models["clip_model"] == _PHOTOS:
        row += "_photos"
    elif row in ("view_features", "metrics", "rests") and models["clip_model"] != _SMALL:
        row += "_published"
    return COSTS[row]


def memory_mb(stage: str, config: Config, inputs: Iterable[str], attempt: int, chunk: bool = False) -> int:
    """Memory to request, a multiple of 100 [MB]; raises as ``Sizes``.

    Args:
        stage: one with a row in ``COSTS``.
        inputs: paths of the job's inputs.
        attempt: from 1; attempt n requests n times as much.
        chunk: as for ``Sizes``.
    """
    sizes = Sizes(stage, config, inputs, chunk=chunk)
    cost = cost_of(stage, config, sizes)
    held = {unit: mb * sizes.times(unit) for unit, mb in cost.mb.items()}
    if "video" in held:
        held["video"] = min(held["video"], _HELD_MB)
    cuda_mb = _CUDA_MB * gpus(stage, config)
    needed = _SNAKEMAKE_MB + _MEMORY_MARGIN * (cost.base_mb + sum(held.values()) + cuda_mb)
    return attempt * 100 * math.ceil(needed / 100)


def runtime_min(stage: str, config: Config, inputs: Iterable[str], attempt: int, chunk: bool = False) -> int:
    """Time to request, in whole minutes, a day at most; arguments and errors as for ``memory_mb``."""
    expected = minutes(stage, config, Sizes(stage, config, inputs, chunk=chunk))
    model = {"segments": "sam2_config", "view_features": "clip_model"}.get(stage)
    if model and config["models"][model] != _SMALL and gpus(stage, config):
        expected /= _GPU_SPEEDUP
    return attempt * math.ceil(min(_START_MIN + _TIME_MARGIN * expected, _DAY_MIN))


def minutes(stage: str, config: Config, sizes: Sizes) -> float:
    """Expected time of a stage on two cores with AVX-512 and without a GPU [min]. The start of Python takes 0.1."""
    cost = cost_of(stage, config, sizes)
    return 0.1 + sum(each * sizes.times(unit) for unit, each in cost.minutes.items())


def gpus(stage: str, config: Config) -> int:
    """GPUs that a job of the stage can use: 1 if a key lets models or rendering run on one, else 0."""
    if stage == "segments" and config["segments"]["segmenter"] == "classical":
        return 0
    # Tracks are copied as they are.
    if stage == "instances" and not merges_masks(config):
        return 0
    values = stage_values(stage, config)
    return int(any(values.get(key) in _ON_GPU for key in ("device", "backend")))
