"""The page of carries draws each way, time and photograph with its number, and says so if there are none."""

import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Annotation

from egosplat.geometry import ground_axes
from egosplat.report.sheets.carries_sheet import COLUMNS, PICTURES
from tests.support.scenes import UP, put_scene

NAMES = ("frames", "poses", "splats", "histories")
FRAMES, HEIGHT, WIDTH = 150, 60, 80

# Frames in a second.
SECOND = 2


def put_carries(folder, first, last):
    """A scene with a carry for each first and last frame [s], along x, each a meter behind the one before."""
    count, rng = len(first), np.random.default_rng(len(first))
    cameras = np.tile(np.eye(4), (FRAMES, 1, 1))
    cameras[:, :3, 3] = 1.6 * UP
    starts = np.arange(count)[:, None] * [0, 0, 1.0]
    gray = np.arange(FRAMES, dtype=np.uint8)
    frames = {"first": np.array(first), "last": np.array(last), "best": np.array(first) + 1}
    arrays = {
        "rgb": np.broadcast_to(gray[:, None, None, None], (FRAMES, HEIGHT, WIDTH, 3)),
        "timestamp_ns": np.arange(FRAMES) * (10**9 // SECOND),
        "camera_to_world": cameras,
        "means": rng.uniform([-4, -2.5, -4], [4, 0, 4], (500, 3)).astype(np.float32),
        "carries/start": starts,
        "carries/end": starts + [2.0, -0.5, 0.0],
        **{f"carries/{name}_frame": (SECOND * when).astype(np.int64) for name, when in frames.items()},
        **{f"carries/{name}": np.full(count, -1, np.int32) for name in ("thing", "from_rest", "to_rest")},
        "carries/box": np.tile(np.int32([30, 20, 40, 28]), (count, 1)),
    }
    facts = {"notes": {}, "tracks": 7, "views": {"training": 1}}
    return put_scene(folder, NAMES, arrays, facts, origin="real")


@pytest.fixture
def page(tmp_path, draw, drawn):
    """``page(first, last)``: the figure of a scene with these carries."""

    def make(first, last):
        draw("carries_sheet", put_carries(tmp_path, first, last), "mine/kitchen")
        return drawn[-1]

    return make


def test_an_arrow_leads_from_start_to_end_and_has_the_number_and_the_color_of_its_bar(page):
    figure = page([3, 61], [8, 64])
    above, times = figure.get_axes()[:2]
    arrows = [text for text in above.texts if isinstance(text, Annotation)]
    places = np.array([[[0, 0, 0], [2, -0.5, 0]], [[0, 0, 1], [2, -0.5, 1]]])
    assert np.allclose([[arrow.xyann, arrow.xy] for arrow in arrows], places @ ground_axes(UP).T)
    names = {text.get_text().strip(): text for text in above.texts if not isinstance(text, Annotation)}
    assert set(names) == {"1", "2"}
    bars = [(bar.get_x(), bar.get_width(), to_rgb(bar.get_facecolor())) for bar in times.patches]
    assert [bar[:2] for bar in bars] == [(3.0, 5.0), (61.0, 3.0)]
    colors = [to_rgb(arrow.arrow_patch.get_edgecolor()) for arrow in arrows]
    assert colors == [bar[2] for bar in bars] and colors[0] != colors[1]
    assert [to_rgb(names[number].get_bbox_patch().get_edgecolor()) for number in "12"] == colors
    assert [int(tick.get_text()) for tick in times.get_yticklabels()] == [1, 2]
    ticks = [tick.get_text() for tick in times.get_xticklabels()]
    assert {"0:00", "1:00"} <= set(ticks) and len(set(ticks)) == len(ticks)


def test_photographs_show_the_longest_first_in_the_frames_that_show_most(page, unreadable):
    first = list(range(0, 42, 3))
    last = [second + 1 + number % 3 * 0.5 for number, second in enumerate(first)]
    last[4] = first[4] + 40
    figure = page(first, last)
    titles = [axes.get_title() for axes in figure.get_axes()[2:]]
    assert len(titles) == PICTURES == 2 * COLUMNS and titles[0] == "5: 0:12 to 0:52"
    numbers = [int(re.fullmatch(r"(\d+): \d:\d\d to \d:\d\d", title)[1]) for title in titles]
    lengths = [last[number - 1] - first[number - 1] for number in numbers]
    assert lengths == sorted(lengths, reverse=True)
    assert "2 shorter ones" in figure.subfigs[1].texts[0].get_text()
    cell = figure.get_axes()[2]
    picture, (box,) = cell.images[0].get_array(), cell.patches
    # A square of the least side around the box.
    assert (picture == 13 * SECOND).all() and picture.shape[:2] == (48, 48)
    assert (box.get_width(), box.get_height()) == (10, 8)
    assert (box.get_x(), box.get_y()) == (30 - (70 - 48) // 2 - 0.5, 20 - 0 - 0.5)
    assert unreadable(figure) == []


def test_the_title_counts_carries_and_a_scene_without_any_is_shown(page):
    title = page([3], [8]).get_suptitle().partition("\n")[0]
    told = "mine/kitchen: movements of objects, hands or people: 1"
    assert title.startswith(told) and title.endswith("origin real")
    figure = page([], [])
    assert "nothing moved" in figure.get_suptitle() and "origin real" in figure.get_suptitle()
    (above,) = figure.get_axes()
    assert not above.texts
    shown = above.collections[0].get_offsets()
    assert 300 < len(shown) < 500, "what is higher than the cameras is left out"
