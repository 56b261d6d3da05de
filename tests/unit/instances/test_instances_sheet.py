"""The page of instances draws frames, and the Gaussians from above where there are some."""

import cv2

from egosplat.instances import stage
from egosplat.pipeline.stages import run_stage
from tests.unit.instances.conftest import options


def draw(folder, name, source):
    """Pixels of the page of a source."""
    frames, poses, segments = (folder / f"{kind}.zarr" for kind in ("frames", "poses", "segments"))
    instances, page = folder / f"{name}.zarr", folder / f"{name}.png"
    stage.run(frames, poses, segments, instances, options(source=source))
    given = {"frames": frames, "poses": poses, "instances": instances}
    run_stage("instances_sheet", None, **given, output=page, title="adt/scene1")
    return cv2.imread(str(page))


def test_the_view_from_above_is_there_if_masks_were_merged(scene):
    folder = scene({"segmenter": "sam2"})
    merged, tracks = draw(folder, "merged", "masks"), draw(folder, "tracks", "tracks")
    assert merged.shape[1] > tracks.shape[1] and merged.shape[0] == tracks.shape[0]
    right = merged[:, tracks.shape[1] :]
    # Two squares of the wall, in two colors.
    assert len({tuple(color) for color in right.reshape(-1, 3) if color.max() - color.min() > 120}) >= 2
