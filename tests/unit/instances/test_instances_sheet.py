"""The page of instances draws frames, and the Gaussians from above where there are some."""

import cv2
import numpy as np

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES as FRAMES_SCHEMA
from egosplat.artifacts.schemas import INSTANCES, SEGMENTS
from egosplat.drawing import plt
from egosplat.instances import stage
from egosplat.report.sheets import instances_sheet
from tests.unit.instances.conftest import COLORS, FRAMES, LEFT, RIGHT, SIZE, options


def find(folder, name, source):
    """Instances of a source, in an artifact of this name; what it was made from."""
    inputs = [folder / f"{kind}.zarr" for kind in ("frames", "poses", "segments")]
    stage.run(*inputs, folder / f"{name}.zarr", options(source=source))
    return inputs


def draw(folder, name, source):
    """Pixels of the page of a source."""
    inputs, page = find(folder, name, source), folder / f"{name}.png"
    instances_sheet.run(*inputs, folder / f"{name}.zarr", page, title="adt/scene1")
    return cv2.imread(str(page))


def test_the_view_from_above_is_there_if_masks_were_merged(scene):
    folder = scene({"segmenter": "sam2"})
    merged, tracks = draw(folder, "merged", "masks"), draw(folder, "tracks", "tracks")
    assert merged.shape[1] > tracks.shape[1]
    right = merged[: tracks.shape[0], tracks.shape[1] :]
    assert merged.shape[0] > tracks.shape[0], "crops before and after merging"
    # Two squares of the wall, in two colors.
    assert len({tuple(color) for color in right.reshape(-1, 3) if color.max() - color.min() > 120}) >= 2


def test_crops_show_the_mask_that_holds_most_of_an_instance_and_the_instance(scene, truth):
    """Above, the mask of the same square of the wall in its frame; below, the merged square."""
    folder = scene(**{"instances/first_frame": np.arange(FRAMES) // 2 * 2})
    find(folder, "merged", "masks")
    kinds = {"frames": FRAMES_SCHEMA, "segments": SEGMENTS, "merged": INSTANCES}
    frames, segments, instances = (
        open_artifact(folder / f"{name}.zarr", schema) for name, schema in kinds.items()
    )
    shown = instances_sheet.shown_in(segments, instances)
    first, second = instances_sheet.largest_and_most_changed(instances, shown)
    assert {first, second} == {0, 1}
    _, cells = plt.subplots(2, 3, squeeze=False)
    instances_sheet.draw_merged_crops(cells, frames, segments, instances, first, shown)
    square = next(
        value
        for value in (LEFT, RIGHT)
        if (truth[4] == value)[instances.row("labels", 4)[1] == first].mean() > 0.9
    )
    titles = [[cell.get_title() for cell in row] for row in cells]
    assert titles[0] == [f"frame {frame}: mask {frame + square} of segments.zarr" for frame in (0, 4, 8)]
    assert titles[1] == [f"instance {first}, merged from 5 masks"] * 3
    above = cells[0, 1].images[0].get_array()
    assert above.shape == (SIZE, int((truth[4, 0] == square).sum()), 3)
    assert (above.reshape(-1, 3) == COLORS[square]).all()
    plt.close("all")
