"""A small scene for the scene page, and what the page's data mean, read back in Python."""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Camera
from egosplat.language.vectors import unit
from egosplat.models.checkpoints import CLIP, model_hash
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.query.finished_scene import open_scene
from egosplat.query.like import see
from egosplat.query.text import encode_phrases
from egosplat.query.things import Surface, find_neighbors
from egosplat.viewing.gaussians import STEP
from egosplat.viewing.html import Arrays, Facts, data_of
from egosplat.viewing.options import ScenePageOptions
from egosplat.viewing.stage import run
from tests.support.gaussian_scene import SETTINGS, opaque, photographs
from tests.support.scenes import UP, camera_facts, put, sideways

SIDE = 96
CAMERA = Camera(SIDE, SIDE, 60.0, 60.0, SIDE / 2, SIDE / 2)
LEVELS = ["part", "whole"]
# By x of a Gaussian, what it means: a couch on the left, a wall in the middle, a cup on the right.
WORDS = ("couch", "wall", "cup")
# Where the cup is taken up after 0.1 s, and put down after 0.2 s.
TAKEN_UP, PUT_DOWN = (-1.0, 0.0, 2.0), (1.0, 0.0, 2.0)
# What is around the thing of each of ``WORDS`` in its frame.
BOXES = [(0, 0, 30, 96), (33, 0, 63, 96), (66, 0, 96, 96)]
TITLE = 'scene </script><b id="injected">bold</b>'


def wall() -> Gaussians:
    """700 colored Gaussians with view-dependent colors, on a bumpy plane 2 m ahead."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform([-1.6, -1.2, 1.95], [1.6, 1.2, 2.05], (700, 3))
    rgb = rng.integers(60, 200, (700, 3), dtype=np.uint8)
    gaussians = opaque(xyz, rgb, logit=3.0, sh_degree=1)
    gaussians.sh[:, 1:] = torch.from_numpy(rng.normal(0, 0.08, (700, 3, 3))).float()
    gaussians.quats.copy_(torch.from_numpy(rng.normal(size=(700, 4))).float())
    gaussians.log_scales += torch.from_numpy(rng.normal(0, 0.3, (700, 3))).float()
    return gaussians


def put_page_scene(
    folder: Path, origin: str = "synthetic", arm: bool = False, masked: bool = True
) -> Gaussians:
    """Write all artifacts that the page needs, and return the Gaussians; with an ``arm``, perhaps ``masked``, that grows from below in
    frames 1, 2 and 4."""
    gaussians, count, write = wall(), 5, partial(put, folder, origin=origin)
    poses = sideways(np.linspace(-0.8, 0.8, count))
    poses[3] = np.nan
    meant = np.digitize(gaussians.means[:, 0].numpy(), [-0.5, 0.5])
    words = encode_phrases(load_open_clip("small", "small", "cpu", "float32"), WORDS).numpy()
    words = unit(words - words.mean(axis=0)).astype(np.float32)  # pictures are less alike than names
    vectors = words[meant]
    small = {"clip_model": "small", "clip_checkpoint": "small"}
    digest = model_hash(CLIP, small)
    rgb = photographs(gaussians, np.nan_to_num(poses), CAMERA)
    write("frames", {"rgb": rgb, "train": np.ones(count, bool)}, camera_facts(CAMERA))
    arrays = {"camera_to_world": poses, "registered": np.isfinite(poses).all(axis=(1, 2)), "up": UP}
    write("poses", arrays | {"intrinsics": CAMERA.matrix}, camera_facts(CAMERA), made_from=["frames"])
    arrays = {
        "gaussians/xyz": gaussians.means.numpy(),
        "gaussians/instance": np.stack([meant, meant + 3], axis=1).astype(np.int32),
        "instances/level": np.repeat([0, 1], len(WORDS)).astype(np.int8),
        "labels": np.zeros((count, len(LEVELS), CAMERA.height, CAMERA.width), np.int32),
    }
    facts = {"levels": LEVELS, "source": "masks", "instances": dict.fromkeys(LEVELS, len(WORDS))}
    shown = np.array([1, 2, 4] if arm else [], np.int32)
    level = arrays["instances/level"] = np.append(arrays["instances/level"], np.ones(int(arm), np.int8))
    for frame in shown:
        arrays["labels"][frame, 1, SIDE - 4 * frame :, 20:30] = 6
    write("instances", arrays, facts, made_from=["frames", "poses"])
    clip = {"model": "small", "checkpoint": "small", "hash": digest, "small": True}
    facts = {"levels": LEVELS, "clip": clip, "decoder": {"widths": [words.shape[1]]}}
    facts |= {"outliers": 2, "slipped": 1}
    features = {"consistent": np.concatenate([words, words, words[:arm]]) if arm else words}
    if arm:
        boxes = np.array([(20, SIDE - 4 * frame, 30, SIDE) for frame in shown], np.int32)
        views = {"instance": np.full(3, 6, np.int32), "frame": shown, "box": boxes, "area": 40 * shown}
        write("view_features", views | {"instances/level": level}, facts, made_from=["instances"])
        masks = {"refined": rgb[..., 0] < 0, "instances/transient": masked & (np.arange(len(level)) == 6)}
        write("masks", masks, made_from=["instances"])
    made_with = {"options": small, "models": {"clip_checkpoint": digest}}
    write("features", features, facts, made_from=["view_features" if arm else "instances"], **made_with)
    names = ("means", "quats", "log_scales", "logit_opacities", "sh")
    stored = {name: getattr(gaussians, name).numpy() for name in names}
    facts = {"camera": asdict(CAMERA), "sh_degree_in_use": 1, "views": {"training": count}}
    write("splats", stored, facts, options=asdict(SETTINGS), made_from=["frames", "poses", *["masks"] * arm])
    code = np.stack([np.zeros_like(vectors), vectors], axis=1)
    share = np.tile(np.float32([0, 1]), (len(code), 1))
    # At the level of parts, some Gaussians of the couch alone have a code: a weaker answer.
    some = np.flatnonzero(meant == 0)[:60]
    code[some, 0], share[some, 0] = vectors[some], 1
    made_from = ["frames", "poses", "features", "splats"]
    write("language", {"code": code, "share": share}, {"levels": LEVELS}, made_from=made_from)
    return gaussians


def put_histories(
    folder: Path, spans: Sequence[tuple[int, int]] = ((0, 1), (2, 4)), **changes: Any
) -> Gaussians:
    """Write histories.zarr of ``put_page_scene``: the cup, where it is taken up and then where it is put down, and a thing that nobody
    sees put down. Returns the Gaussians of both rests of the cup. ``spans``: first and last frame of the rests, in turn at both places;
    further ones are of a second thing without views. ``changes``: other arrays, ``/`` in a name as ``__``."""
    count, of_cup = len(spans), min(len(spans), 2)
    center = np.array([(TAKEN_UP, PUT_DOWN)[number % 2] for number in range(count)]).reshape(-1, 3)
    offsets = np.array([[x, y, -0.4] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    xyz = (center[:, None] + offsets).reshape(-1, 3)
    sh = np.zeros((len(xyz), 4, 3), np.float32)
    sh[:, 0, 0] = 1.7
    stored = {
        "means": xyz.astype(np.float32),
        "quats": np.tile(np.float32([1, 0, 0, 0]), (len(xyz), 1)),
        "log_scales": np.full((len(xyz), 3), np.log(0.08), np.float32),
        "logit_opacities": np.full(len(xyz), 4.0, np.float32),
        "sh": sh,
    }
    cup = encode_phrases(load_open_clip("small", "small", "cpu", "float32"), ["cup"]).numpy()
    frames = np.array(spans, np.int64).reshape(-1, 2)
    arrays = {
        "carries/first_frame": np.array([1, 2]),
        "carries/last_frame": np.array([2, 3]),
        "carries/start": np.array([TAKEN_UP, [0.0, 0.0, 2.0]]),
        "carries/end": np.array([PUT_DOWN, [np.nan] * 3]),
        "carries/size": np.full(2, 0.1),
        "carries/best_frame": np.array([2, 2]),
        "carries/box": np.array([[10, 20, 30, 40]] * 2, np.int32),
        "rests/thing": np.array([0] * of_cup + [1] * (count - of_cup), np.int32),
        "rests/from_frame": frames[:, 0],
        "rests/until_frame": frames[:, 1],
        "rests/absent_before": np.full(count, -1),
        "rests/absent_after": np.full(count, -1),
        "rests/center": center,
        "carries/thing": np.array([0 if of_cup else -1, -1], np.int32),
        "carries/from_rest": np.array([0 if of_cup else -1, -1], np.int32),
        "carries/to_rest": np.array([1 if of_cup > 1 else -1, -1], np.int32),
        "things/feature": np.concatenate([cup, np.zeros_like(cup)])[: 0 if not count else 1 + (count > 2)],
        "gaussians/rest": np.repeat(np.arange(count, dtype=np.int32), len(offsets)),
    }
    arrays |= {f"gaussians/{name}": one for name, one in stored.items()}
    arrays |= {name.replace("__", "/"): np.array(values) for name, values in changes.items()}
    put(folder, "histories", arrays, made_from=["frames", "poses", "instances", "splats"])
    stored = {name: torch.from_numpy(one) for name, one in stored.items()}
    return Gaussians(**stored, features=torch.zeros(len(xyz), 0))


def put_looks(folder: Path) -> list[np.ndarray]:
    """Write view_features.zarr of ``put_page_scene``: its things in frames 0 and 2, as features of pictures. Returns a picture of each."""
    opened = open_scene(folder, device="cpu")
    views = [(thing, frame, BOXES[thing]) for thing in range(3) for frame in (0, 2)]
    crops = [opened.frames[frame][y0:y1, x0:x1] for _, frame, (x0, y0, x1, y1) in views]
    feature = np.concatenate([see(opened.clip, crop)[:1] for crop in crops]).astype(np.float32)
    thing, frame, box = (np.array(column, np.int32) for column in zip(*views, strict=True))
    arrays = {"instance": thing, "frame": frame, "box": box, "area": frame + 9, "feature": feature}
    level = opened.artifact("instances").read("instances/level")
    facts = opened.encoded.facts
    put(folder, "view_features", arrays | {"instances/level": level}, facts, made_from=["instances"])
    return crops[::2]


def page_options(**changes: Any) -> ScenePageOptions:
    """The default keys of the page, but for changes."""
    return ScenePageOptions(**{"device": "cpu"} | changes)


def write_page(folder: Path, title: str = TITLE, **changes: Any) -> Path:
    """Write ``folder/scene.html`` from the artifacts in the folder."""
    names = ("frames", "poses", "instances", "features", "splats", "language", "histories")
    paths = {f"{name}_path": path for name in names if (path := folder / f"{name}.zarr").exists()}
    run(**paths, output=folder / "scene.html", options=page_options(**changes), title=title)
    return folder / "scene.html"


def unpack(text: str) -> tuple[Facts, Arrays]:
    """Read what ``pack`` wrote."""
    raw = gzip.decompress(base64.b64decode(text))
    length = int(np.frombuffer(raw, np.uint32, 1)[0])
    header, place = json.loads(raw[4 : 4 + length]), 4 + length
    arrays: Arrays = {}
    for name, about in header["arrays"].items():
        dtype, size = np.dtype(about["dtype"]), int(np.prod(about["shape"]))
        planes = np.frombuffer(raw, np.uint8, size * dtype.itemsize, place).reshape(dtype.itemsize, size)
        arrays[name] = np.ascontiguousarray(planes.T).view(dtype).reshape(about["shape"])
        place += size * dtype.itemsize
    return header["facts"], arrays


def contents_of(page: Path) -> tuple[Facts, Arrays]:
    """The facts and arrays in a page."""
    return unpack(data_of(page.read_text()))


def means_of(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """(N, 3) float32 centers on the page, those of rests at the end."""
    block = np.arange(arrays["position"].shape[1]) // facts["block"]
    means = arrays["block_low"][:, block] + arrays["position"] * arrays["block_step"][:, block]
    return means.T.astype(np.float32)


def scales_of(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """(N, 3) float32 standard deviations on the page."""
    low, high = facts["log_scale_range"]
    return np.exp(low + arrays["log_scale"].T / 255 * (high - low)).astype(np.float32)


def shares_of(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(V, N) shares of the stored views, and (N,) mean share of all views."""
    shown = np.unpackbits(arrays["seen"], axis=1, count=facts["count"]).astype(bool)
    shares = np.zeros(shown.shape, np.float32)
    shares[shown] = from_bytes(arrays["seen_share"], facts["share_smallest"])
    return shares, from_bytes(arrays["visible"], facts["mean_smallest"])


def from_bytes(values: np.ndarray, smallest: float) -> np.ndarray:
    """What ``to_bytes`` wrote."""
    return np.where(values > 0, smallest * STEP ** (values.astype(float) - 1), 0).astype(np.float32)


def surface_of(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Surface:
    """The surface that the page queries, for the package's own functions."""
    shares, mean = shares_of(facts, arrays)
    radii = scales_of(facts, arrays).max(axis=1).astype(np.float64)
    weight = mean[:, None] * (arrays["code_share"] / 255).T.astype(np.float32)
    means, seen = means_of(facts, arrays).astype(np.float64), np.array(facts["seen_frames"])
    instance = arrays["instance"][-1].astype(np.int32) - 1
    return Surface(means, find_neighbors(means, radii), shares, weight, seen, facts["levels"], instance)
