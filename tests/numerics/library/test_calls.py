"""Public functions of the library: numbers at their extremes end in one clear line or in a sound answer."""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import cv2
import numpy as np
import pytest

import egosplat

NO_WHOLES, NO_TIMES = (2.5, nan, inf, "2", [2]), (nan, "soon", [1.0])

# Values of keys of a query that are refused, and others that are not.
QUERY = {
    "min_score": ((nan, inf, -1, 1.1), (0, 1)),
    "temperature": ((nan, inf, -1, 0), (1e-30, 1e-3, 1e30, 1e300)),
    "box_filter": ((nan, inf, -1, 2), (0, 1e-30, 1)),
    "present_share": ((nan, 2, 0), (1e-30, 1)),
    "size_weight": ((nan, inf, -1, 1e30), (0, 2)),
    "resolution": ((nan, -1, 2.5), (1, 10**6)),
    "canonical": (([], [""]), (["object"], ["x", "x"])),
}
STAGE = {
    "iterations": (0, -1, 2.0, nan, 1e30),
    "seed": (-1, 2**31),
    "sh_degree": (-1, 4),
    "near_plane": (0, -1, nan, inf),
    "max_gaussians": (0, -1, nan),
}


def moved(scene: egosplat.Scene, x: float, factor: float = 1.0) -> np.ndarray:
    """The pose of frame 2 at another x, with its first number times a factor."""
    pose = scene.poses[2].copy()
    pose[0, 3], pose[0, 0] = x, pose[0, 0] * factor
    return pose


def seen(scene: egosplat.Scene, **camera: float) -> np.ndarray:
    """Frame 2 by a camera with other numbers."""
    return scene.render(2, camera=replace(scene.camera, **camera))


def ask_picture(scene: egosplat.Scene, *shape: int) -> list[egosplat.Answer]:
    cv2.imwrite("crop.png", np.zeros((*shape, 3), np.uint8))
    return egosplat.ask_pictures(scene, "crop.png")


def run(**keys: object) -> None:
    """A training that is refused before it begins."""
    inputs = {name: f"results/adt/scene1/{name}.zarr" for name in ("frames", "poses")}
    egosplat.run_stage("splats", **inputs, output="o.zarr", masking="none", **keys)


def thing(scene: egosplat.Scene) -> egosplat.Thing:
    return scene.ask("couch")[0].things[0]


# The argument, the words of the error, the call, and the values that are refused.
REFUSED: list[tuple[str, str, Callable, tuple]] = [
    ("ask: frame", "frame is", lambda s, v: s.ask("cup", frame=v), NO_WHOLES),
    ("ask: frame of 5", "frame", lambda s, v: s.ask("cup", frame=v), (-1, 5, 10**9)),
    ("ask: pose at x", "rigid", lambda s, v: s.ask("cup", pose=moved(s, v)), (nan, inf)),
    ("ask: pose at x [m]", "from the origin", lambda s, v: s.ask("cup", pose=moved(s, v)), (1e19, -1e300)),
    ("ask: pose scaled by", "rigid", lambda s, v: s.ask("cup", pose=moved(s, 0, v)), (1.001, 1e30, 0)),
    ("ask: pose", "rigid", lambda s, v: s.ask("cup", pose=v), ([], [[1.0]])),
    ("ask: second", "no time", lambda s, v: s.ask("cup", pose=s.poses[2], second=v), NO_TIMES),
    ("ask: most", "most is", lambda s, v: s.ask("cup", most=v), (0, -1, *NO_WHOLES)),
    ("ask: query", "is a text", lambda s, v: s.ask(v), (None, 3, nan, b"cup", ["cup"])),
    ("show: resolution", "resolution", lambda s, v: s.show("couch", thing(s), v), (-1, 2.5, nan)),
    ("Answer.at", "no time", lambda s, v: s.ask("cup")[0].at(v), NO_TIMES),
    ("render: frame", "frame is", lambda s, v: s.render(v), NO_WHOLES),
    ("render: pose at x [m]", "from the origin", lambda s, v: s.render(pose=moved(s, v)), (1e19, 1e39)),
    ("render: width [px]", "image is", lambda s, v: seen(s, width=v), (0, -3, 10**7)),
    ("frames", "frame is", lambda s, v: s.frames[v], NO_WHOLES),
    ("artifact", "is no artifact", lambda s, v: s.artifact(v), ("", "splat", None, 3)),
    ("ask_pictures: a side [px]", "12 px a side", lambda s, v: ask_picture(s, v, 5000), (1, 8)),
    *((f"ask: {key}", key, lambda s, v, key=key: s.ask("cup", **{key: v}), no) for key, (no, _) in QUERY.items()),
    *((f"run_stage: {key}", key, lambda _, v, key=key: run(**{key: v}), no) for key, no in STAGE.items()),
]  # fmt: skip


def within_limits(key: str, values: tuple[float, ...]) -> Callable[[egosplat.Scene], bool]:
    """Whether answers with these values of a key, in the scene and in a view, have scores and probabilities of 0 to 1."""

    def check(scene: egosplat.Scene) -> bool:
        keys = [{key: value} | view for value in values for view in ({}, {"frame": 2})]
        answers = [one for given in keys for one in scene.ask("cup", "couch", **given)]
        things = [one for answer in answers for one in (*answer.things, *filter(None, [answer.view]))]
        return all(0 <= one.score <= 1 and 0 <= (getattr(one, "probability", 0) or 0) <= 1 for one in things)

    return check


def unasked(*queries: str) -> Callable[[egosplat.Scene], bool]:
    """Whether queries are refused, in the scene and in a view."""
    return lambda s: all(one.refusal for view in ({}, {"frame": 2}) for one in s.ask(*queries, **view))


def sees(*cameras: tuple[int, int, float]) -> Callable[[egosplat.Scene], bool]:
    """Whether pictures of these widths, heights and focal lengths [px] are finite."""
    return lambda s: all(np.isfinite(seen(s, width=w, height=h, fx=f)).all() for w, h, f in cameras)


# What is tried, what comes, and whether it came.
SOUND: list[tuple[str, str, Callable]] = [
    ("ask: no query", "no answer", lambda s: s.ask() == s.ask(frame=2) == []),
    ("ask: blank queries", "not asked", unasked("", "  ", "\n")),
    ("ask: 1e5 letters, 2e4 words", "not asked", unasked("x" * 100_000, "couch " * 20_000)),
    ("ask: half a letter, an emoji", "refused", unasked("\ud800", "🛋️")),
    ("ask: 1000 unknown words", "refused", unasked(*(f"w{i}" for i in range(1000)))),
    ("ask: pose at x of 1e17 m", "an answer", lambda s: len(s.ask("cup", pose=moved(s, 1e17))) == 1),
    ("ask: second of -1e300", "an answer", lambda s: s.ask("cup", pose=s.poses[2], second=-1e300)),
    ("ask: frame as uint8", "as int", lambda s: s.ask("cup", frame=np.uint8(2))[0].view.pixel == (84, 48)),
    ("render: pose at x of 1e17 m", "finite", lambda s: np.isfinite(s.render(pose=moved(s, 1e17))).all()),
    ("render: focal length of 1e-30, 1e30 px", "finite", sees((96, 96, 1e-30), (96, 96, 1e30))),
    ("render: images of 1x1, 1x4000 px", "finite", sees((1, 1, 0.6), (1, 4000, 0.6))),
    ("show: resolution of 1e6 px", "as the frame", lambda s: s.show("couch", thing(s), 10**6).mask.shape == (96, 96)),
    ("Answer.at: -infinity", "as the first frame", lambda s: s.ask("cup")[0].at(-inf).position[0] == -1),
    ("Answer.at: 1e300 s", "as the last frame", lambda s: s.ask("cup")[0].at(1e300).position[0] == 1),
    *((f"ask: {key} {', '.join(map(str, ok))}", "scores of 0 to 1", within_limits(key, ok)) for key, (_, ok) in QUERY.items()),
]  # fmt: skip


def cases(table: list[tuple], tell: Callable[[tuple], tuple[str, str]]) -> list[object]:
    return [
        pytest.param(*one, id=tell(one)[0], marks=pytest.mark.numerics(tell(one)[0], outside=tell(one)[1]))
        for one in table
    ]


def tell_refused(case: tuple) -> tuple[str, str]:
    return f"{case[0]} {', '.join(f'{value!r:.12}' for value in case[3])}", f'error "{case[1]}"'


@pytest.fixture
def scene(work) -> egosplat.Scene:
    return egosplat.open_scene("results/adt/scene1")


@pytest.mark.parametrize("name, said, call, values", cases(REFUSED, tell_refused))
def test_refused(scene, name, said, call, values):
    for value in values:
        with pytest.raises((egosplat.UserError, ValueError)) as error:
            call(scene, value)
        assert said in (text := str(error.value)) and text.count("\n") < 2 and len(text) < 400
    assert not Path("o.zarr").exists()


@pytest.mark.parametrize("tried, comes, check", cases(SOUND, lambda one: one[:2]))
def test_sound(scene, tried, comes, check):
    assert check(scene)
