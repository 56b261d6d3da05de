"""Detect motion in a recording: optical flow that neither the known poses nor a small error of theirs explains."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from egosplat.arrays import Array, Bools, Floats, Ints, Ints32
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import length_unit, shown_pixels
from egosplat.geometry import Camera, invert
from egosplat.images import resize_mask, shrunk_size
from egosplat.moving_regions import landing, lasting_regions, meetings
from egosplat.progress import track
from egosplat.survey import views
from egosplat.survey.brightness import exposure_changes
from egosplat.survey.pairs import Match, detect_motion
from egosplat.survey.rigid import View

# Longest side of the images that flow is computed of [px].
_SIDE = 256
# Motion is undecided if fewer pixels than this fraction can show it, or fewer pairs.
_MIN_VOTING, _MIN_PAIRS = 0.05, 2
# Minimum depth of static points: half the depth of the nearest 2 % of the points.
_NEAR_QUANTILE, _NEAR_FACTOR = 0.02, 0.5
# Without points, in meters: an arm's length is 0.6 m.
_DEFAULT_MIN_DEPTH, _DEFAULT_DEPTH = 0.2, 2.0

# One pair in so many is compared again after a second or more, for the poses.
_PAIRS_PER_REVISIT = 4


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion in P pairs of frames, and R pairs of frames that show the same again later.

    Attributes:
        depths: (F,) float64 median depth of what each frame shows [m], see ``views.median_depths``.
        pairs: (P, 2) int64 frames.
        moving, lasting: (P,) float64 pixels in moving regions, and in those that move in three pairs in a row, as a
            fraction of the valid ones.
        voting: (P,) float64 pixels that can show motion, as a fraction of the valid ones.
        stops: (P,) float64 exposure of the second frame relative to the first; NaN if unknown.
        before_px, after_px: (P + R,) float64 noise of the flow without and with a correction of the poses [px]; NaN if the
            pair is not judged.
    """

    depths: Array
    pairs: Ints
    moving: Array
    lasting: Array
    voting: Array
    stops: Array
    before_px: Array
    after_px: Array

    @property
    def noise_px(self) -> Array:
        """(P,) float64 ``after_px`` of the pairs."""
        return self.after_px[: len(self.pairs)]

    @property
    def shares(self) -> tuple[float, float] | None:
        """Fractions of the voting pixels in regions that keep moving, and in those that move and are not seen to move
        again; None if too few pixels can show motion."""
        judged = np.isfinite(self.noise_px)
        voting = self.voting[judged].sum()
        if judged.sum() < _MIN_PAIRS or voting < _MIN_VOTING * len(self.pairs):
            return None
        moving, lasting = (float(pixels[judged].sum() / voting) for pixels in (self.moving, self.lasting))
        return lasting, moving - lasting


def measure_motion(frames: Artifact, poses: Artifact) -> Motion:
    """Measure motion between pairs of frames throughout a recording."""
    times_ns, registered = frames.read("timestamp_ns"), poses.read("registered")
    camera_to_world, points = poses.read("camera_to_world"), poses.read("points/xyz")
    valid, shown, camera = _working_view(frames, poses)
    # The unit of the default depths: a meter, or the way between the outermost of the cameras if no scale is known.
    spread = (
        float(np.linalg.norm(np.ptp(camera_to_world[registered, :3, 3], axis=0))) if registered.any() else 0.0
    )
    unit = spread if spread > 0 and length_unit(poses) != "m" else 1.0
    depths = views.median_depths(camera, camera_to_world, registered, points)
    pairs = views.choose_pairs(times_ns, registered)
    count = len(pairs)
    revisits = views.choose_revisits(camera_to_world, depths, times_ns, count // _PAIRS_PER_REVISIT)
    found, lights, flows = [], [], []
    for row, (first, second) in enumerate(
        track(np.concatenate([pairs, revisits]).tolist(), "measuring motion", unit="pair")
    ):
        gray = (cv2.cvtColor(frames.row("rgb", frame), cv2.COLOR_RGB2GRAY) for frame in (first, second))
        small = [np.asarray(cv2.resize(one, valid.shape[::-1], interpolation=cv2.INTER_AREA)) for one in gray]
        pair_poses, here = (camera_to_world[first], camera_to_world[second]), shown(first)
        match = Match(small[0], small[1], here, camera.matrix, pair_poses, shown(second))
        near = views.depth_quantile(camera, pair_poses[0], points, _NEAR_QUANTILE)
        view = View(
            intrinsics=camera.matrix,
            position=(invert(pair_poses[0]) @ pair_poses[1])[:3, 3],
            depth=float(depths[first]) if np.isfinite(depths[first]) else _DEFAULT_DEPTH * unit,
            min_depth=_NEAR_FACTOR * near if np.isfinite(near) else _DEFAULT_MIN_DEPTH * unit,
        )
        found.append(detect_motion(match, view, here, search=row < count))
        judged = np.isfinite(found[-1].noise_px) and row < count
        lights.append(match.light if judged else None)
        # Flow is kept where something moves, for the next pair.
        flows.append((match.flow, match.homography) if found[-1].regions.any() else None)
    regions = [pair.regions for pair in found[:count]]
    numbers = np.array([(pair.before_px, pair.noise_px) for pair in found]).reshape(-1, 2)
    valid_count = max(1, int(valid.sum()))
    return Motion(
        depths=depths,
        pairs=pairs,
        moving=np.array([np.count_nonzero(labels) for labels in regions]) / valid_count,
        lasting=_lasting(pairs, regions, flows) / valid_count,
        voting=np.array([pair.voting for pair in found[:count]]) / valid_count,
        stops=exposure_changes(lights[:count]),
        before_px=numbers[:, 0],
        after_px=numbers[:, 1],
    )


def _lasting(pairs: Ints, regions: list[Ints32], flows: list[tuple[Floats, Array] | None]) -> Array:
    """(P,) float64 pixels of each pair in regions that keep moving; ``flows`` where some do, with their homographies."""
    row_of = {int(first): row for row, first in enumerate(pairs[:, 0])}
    links = []
    for row, second in enumerate(pairs[:, 1].tolist()):
        after, flow = row_of.get(second), flows[row]
        if after is None or flow is None or flows[after] is None:
            continue
        met = meetings(landing(regions[row], *flow), regions[after])
        links += [((row, one), (after, other)) for one, other in met]
    found = np.zeros(len(pairs))
    for row, region in lasting_regions(links):
        found[row] += np.count_nonzero(regions[row] == region)
    return found


def _working_view(frames: Artifact, poses: Artifact) -> tuple[Bools, Callable[[int], Bools], Camera]:
    """Valid pixels, pixels of each frame that show the scene, and camera, at the size at which flow is computed."""
    _, height, width, _ = frames.shape("rgb")
    size, full = shrunk_size(width, height, _SIDE), frames.read("valid")
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height).scaled_to(*size)
    return (
        resize_mask(full, *size),
        lambda frame: resize_mask(shown_pixels(frames, frame, full), *size),
        camera,
    )
