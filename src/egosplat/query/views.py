"""Answer queries in one view, by ``query.readout`` (docs/method.md#query-views): relevancies of Gaussians are rendered, and a mask is
what those above the threshold fill; or codes are rendered, and each pixel is compared."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array, Bools, Floats
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import render
from egosplat.gaussians.render import view_of as gaussians_in
from egosplat.geometry import Camera, transform
from egosplat.histories.known import Rests
from egosplat.language.decoder import Decoder
from egosplat.query.answers import Thing, ViewMatch
from egosplat.query.maps import Maps, innermost, localize, majority, read_maps, resize_shown, segment
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy, relevancy_maps
from egosplat.query.scene import QueryScene, Viewpoint, rendering_camera
from egosplat.query.text import Texts
from egosplat.rasterize.view import composite, render_codes

# A pixel belongs to a thing if the thing's Gaussians make up more than this share of it.
_HALF = 0.5

# Coverage of a pixel by Gaussians with a code at a level, above which it gets an answer there.
_LEAST_COVERAGE = 0.01


@dataclass(frozen=True, eq=False)
class View:
    """The codes of one view, rendered at (h, w) pixels, for answers of (H, W) pixels by the ``camera``, of which ``valid`` ones count.

    Attributes:
        codes: (L, h, w, C) float32 codes at each level, or relevancies to C queries, divided by their coverage.
        coverage: (L, h, w) float32 share of each pixel that Gaussians with a code cover, 0..1.
        depth: (h, w) float32 expected camera z [m]; 0 where the view is empty.
    """

    codes: Tensor
    coverage: Tensor
    depth: Tensor
    camera: Camera
    camera_to_world: Array
    valid: Bools
    levels: Sequence[str]

    @property
    def seen(self) -> Tensor:
        """(L, h, w) bool pixels that show the scene and have a code at a level."""
        inside = torch.from_numpy(resize_shown(self.valid, *self.depth.shape))
        return (self.coverage > _LEAST_COVERAGE) & inside.to(self.coverage.device)


class Asker:
    """Answers queries in any view of a scene: the Gaussians are compared with all queries once.

    ``own`` (N, L, Q) and ``of_things`` (T, Q) are float32 relevancies of Gaussians and of things that rest; pixels that are
    decoded need none, and do not show what rests.
    """

    def __init__(
        self, scene: QueryScene, texts: Texts, options: QueryOptions, rests: Rests | None = None
    ) -> None:
        self.scene, self.texts, self.options = scene, texts, options
        self.own = self.rests = None
        if options.readout == "gaussians" and not scene.maps_only:
            self.own, self.rests = scene.relevancy(texts, options).permute(2, 1, 0), rests
        if self.rests is not None:
            self.of_things = relevancy(self.rests.feature, texts, options.temperature)

    def ask(self, phrases: Sequence[str], camera: Camera, at: Viewpoint) -> Iterator[ViewMatch]:
        """Answer some of the queries in one view, in order."""
        texts, place = self.texts.of(phrases), (camera, at, self.options.resolution)
        if self.own is None:
            view = view_of(self.scene, *place)
            yield from answer_from_codes(view, self.scene.decoder, texts, self.options)
            return
        small = rendering_camera(camera, self.options.resolution)
        for batch in texts.in_batches(small.width * small.height * self.own.shape[1]):
            chosen = [self.texts.phrases.index(phrase) for phrase in batch.phrases]
            scene = self._at(replace(self.scene, code=self.own[..., chosen]), chosen, at.second)
            yield from answer_from_relevancies(scene, view_of(scene, *place), batch.phrases, self.options)

    def _at(self, scene: QueryScene, chosen: Sequence[int], second: float | None) -> QueryScene:
        """A scene whose codes are relevancies to the chosen queries, with what lies there at a time; its share is 1 at each level."""
        rests = self.rests
        if rests is None or second is None or not len(added := rests.at(second)):
            return scene
        thing = torch.from_numpy(rests.thing[rests.rest]).to(added.device)[added]
        relevancies = self.of_things[thing][:, None, chosen].expand(-1, scene.share.shape[1], -1)
        return replace(
            scene,
            gaussians=Gaussians.concatenate([scene.gaussians, rests.gaussians.select(added)]),
            code=torch.cat([scene.code, relevancies]),
            share=torch.cat([scene.share, scene.share.new_ones(relevancies.shape[:2])]),
        )


@torch.inference_mode()
def view_of(scene: QueryScene, camera: Camera, at: Viewpoint, resolution: int) -> View:
    """Render the codes and the depth of one view; ``resolution`` is as in ``QueryOptions``."""
    place = rendering_camera(camera, resolution), at.camera_to_world, scene.settings
    codes, coverage = render_codes(gaussians_in(scene.gaussians, *place), scene.code, scene.share)
    depth, _, _ = render(scene.gaussians, *place, sh_degree=0, background=None, render_mode="ED")
    shown = np.ones((camera.height, camera.width), bool) if at.valid is None else at.valid
    return View(codes, coverage, depth[..., 0], camera, at.camera_to_world, shown, scene.levels)


def answer_from_codes(
    view: View, decoder: Decoder, texts: Texts, options: QueryOptions
) -> Iterator[ViewMatch]:
    """Answer queries in order, one at a time: each answer holds maps of the image's size (ValueError: a code is not finite)."""
    seen = view.seen
    for batch in texts.in_batches(seen.numel()):
        relevancies = relevancy_maps(view.codes, seen, decoder, batch, options.temperature)
        for match, maps in _located(view, batch.phrases, seen, relevancies, options):
            if match.level is not None:
                side = options.majority_px(max(view.valid.shape))
                level, mask = segment(maps, options.segmentation_threshold, side)
                match = replace(match, mask_level=view.levels[level], mask=mask)
            yield match


def answer_from_relevancies(
    scene: QueryScene, view: View, phrases: Sequence[str], options: QueryOptions
) -> Iterator[ViewMatch]:
    """Answer queries in order from the relevancies of Gaussians, the ``code`` of a scene with a channel for each query, from
    which the view is rendered (docs/method.md#query-masks)."""
    located = []
    for match, maps in _located(view, phrases, view.seen, view.codes.movedim(-1, 0), options):
        # What is visible is so for every query.
        if match.level is None:
            yield match
            continue
        level = view.levels.index(match.level)
        threshold = maps.threshold(level, options.segmentation_threshold)
        located.append((match, level, threshold, maps.shown[level]))
    if located:
        matches, levels, thresholds, shown = zip(*located, strict=True)
        side = options.majority_px(max(view.valid.shape))
        for match, filled, seen in zip(matches, _filled(scene, view, levels, thresholds), shown, strict=True):
            mask = majority(_filled_mask(filled, seen), side) & seen
            yield replace(match, mask_level=match.level, mask=mask)


@torch.inference_mode()
def _filled(scene: QueryScene, view: View, levels: Sequence[int], thresholds: Sequence[float]) -> Floats:
    """(Q, h, w) share of what covers each pixel, at the level of each query, whose relevancy is above its threshold."""
    threshold = torch.tensor(thresholds).to(scene.code)
    own = torch.stack([scene.code[:, level, query] for query, level in enumerate(levels)], dim=1)
    small = view.camera.scaled_to(*reversed(view.depth.shape))
    seen = gaussians_in(scene.gaussians, small, view.camera_to_world, scene.settings)
    image, _ = composite(seen, scene.share[:, list(levels)] * (own > threshold))
    return (image.movedim(-1, 0) / view.coverage[list(levels)].clamp(min=1e-6)).cpu().numpy()


def _filled_mask(filled: Floats, shown: Bools) -> Bools:
    """(H, W) pixels among the ``shown`` of which a thing makes up more than half, from its (h, w) share of each."""
    return (cv2.resize(filled, shown.shape[::-1]) > _HALF) & shown


def _located(
    view: View, phrases: Sequence[str], seen: Tensor, relevancies: Tensor, options: QueryOptions
) -> Iterator[tuple[ViewMatch, Maps]]:
    """The place that fits each query best, without a mask, and the maps of its (Q, L, h, w) relevancy where it is ``seen``."""
    visible, nothing = seen.cpu().numpy(), np.zeros(view.valid.shape, np.float32)
    for phrase, values in zip(phrases, relevancies, strict=True):
        maps = read_maps(np.where(visible, values.cpu().numpy(), np.float32(np.nan)), view.valid, options)
        best = localize(maps.smooth, maps.shown)
        if best is None:
            yield ViewMatch(phrase, 0.0, None, None, None, nothing, None, nothing > 0), maps
            continue
        level, score, pixel = best
        position = pixel_position(view.camera, view.camera_to_world, pixel, view.depth.cpu().numpy())
        shown = np.where(maps.shown[level], maps.raw[level], np.float32(0.0))
        yield ViewMatch(phrase, score, view.levels[level], pixel, position, shown, None, nothing > 0), maps


@torch.inference_mode()
def show_thing(
    scene: QueryScene, thing: Thing, texts: Texts, camera: Camera, at: Viewpoint, options: QueryOptions
) -> ViewMatch:
    """Render the mask of a thing that answers one query, with a pixel in its middle if it shows, and the relevancy of the whole
    view at its level; the viewpoint has ``valid`` pixels."""
    small, level = rendering_camera(camera, options.resolution), scene.levels.index(thing.level)
    # Rendered as a value of 1 among 0, so Gaussians in front of the thing hide it.
    members = torch.zeros(scene.gaussians.count, 1, device=scene.code.device)
    members[torch.from_numpy(thing.members).to(members.device)] = 1.0
    filled, _ = composite(gaussians_in(scene.gaussians, small, at.camera_to_world, scene.settings), members)
    assert at.valid is not None
    mask = _filled_mask(filled[..., 0].cpu().numpy(), at.valid)
    [match] = Asker(scene.of_level(level), texts, options).ask(texts.phrases, camera, at)
    pixel, name = innermost(mask) if mask.any() else None, thing.level
    place = {"level": name, "pixel": pixel, "position": None, "mask_level": name, "mask": mask}
    return replace(match, score=thing.score, **place)


def pixel_position(
    camera: Camera, camera_to_world: Array, pixel: tuple[int, int], depth: Floats
) -> Array | None:
    """The world position shown at the center of a pixel (column and row), (3,) float64 [m]; None without depth, which is (h, w)
    float32 expected camera z [m] of the same view at any resolution, 0 or not finite for none."""
    point = np.array(pixel) + 0.5
    height, width = depth.shape
    # The pixel of the depth map that contains the point; depths across an edge must not be averaged.
    column, row = (point * [width / camera.width, height / camera.height]).astype(int)
    z = float(depth[row, column])
    if not (np.isfinite(z) and z > 0):
        return None
    x, y = (point[0] - camera.cx) / camera.fx, (point[1] - camera.cy) / camera.fy
    return transform(camera_to_world, np.stack([x, y, np.ones_like(x)]) * z)
