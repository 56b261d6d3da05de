"""Artifacts hold only the numbers that their schemas allow, whoever wrote them."""

from itertools import cycle

import numpy as np
import pytest

from egosplat.artifacts.integrity import ArtifactError
from egosplat.artifacts.reader import open_any, verify
from egosplat.artifacts.schema import FINITE, SHARE, Values
from egosplat.artifacts.schemas import SCHEMAS
from tests.support.scenes import put

NAN, INF = np.nan, np.inf
NAMES = [(kind, name) for kind in SCHEMAS for name in SCHEMAS[kind].fields]


def of(*allowed: Values) -> list[tuple[str, str]]:
    """Kind and name of each floating-point array with such values."""
    every = ((kind, name, SCHEMAS[kind].fields[name]) for kind, name in NAMES)
    return [(kind, name) for kind, name, field in every if field.values in allowed and "float" in field.dtype]


def poses(scale: float = 1.0, **changes: float) -> np.ndarray:
    """Two poses with changed entries: ``r`` of the rotation, ``t`` of the translation."""
    made = np.tile(np.eye(4), (2, 1, 1))
    made[1, :3, :3] *= scale
    made[1, 0, 0], made[1, 0, 3] = changes.get("r", made[1, 0, 0]), changes.get("t", 0.0)
    return made


def pinhole(focal: float, skew: float = 0.0) -> np.ndarray:
    return np.array([[focal, skew, 3.0], [0.0, 5.0, 3.0], [0.0, 0.0, 1.0]])


INDICES = [
    ("segments", "labels", -2),
    ("segments", "labels", 2),
    ("segments", "instances/level", 2),
    ("instances", "labels", 2),
    ("instances", "gaussians/instance", 2),
    ("view_features", "instance", 2),
    ("view_features", "instance", -1),
    ("view_features", "instances/level", 1),
    ("features", "instance", 2),
    ("features", "instances/level", 1),
    ("annotations", "instance_map", 3),
]
CASES = {
    "NaN or infinity in any array of numbers": [
        (*one, value) for one, value in zip(of(FINITE), cycle((NAN, INF, -INF)))
    ],
    "shares and probabilities: NaN, infinity, -0.01, 1.01": [
        (*one, value) for one, value in zip(of(SHARE), cycle((INF, NAN, -0.01, 1.01)))
    ],
    "indices below -1, or beyond what they count": INDICES,
    "intrinsics with skew; focal length 0, -1, NaN, infinity": [
        ("poses", "intrinsics", pinhole(*case)) for case in [(0.0,), (-1.0,), (NAN,), (INF,), (5.0, 0.1)]
    ],
    "poses with infinity or one NaN, scaled by 1.001, mirrored; up direction of length 2": [
        *(("poses", "camera_to_world", poses(t=number)) for number in (INF, NAN)),
        *(("poses", "camera_to_world", poses(r=number)) for number in (1.001, -1.0)),
        ("splats", "corrections/camera_to_world", poses(t=INF)),
        ("poses", "up", np.array([0.0, 2.0, 0.0])),
    ],
}


def write(folder, kind, name, bad):
    """Write an artifact that has a bad number in one array; a scalar is the last number of zeros."""
    field = SCHEMAS[kind].fields[name]
    values = np.asarray(bad, field.dtype)
    if not values.ndim:
        values = np.zeros([dim if isinstance(dim, int) else 2 for dim in field.dims], field.dtype)
        values.flat[-1] = bad
    return put(folder, kind, {name: values}, {"levels": ["part"], "instances": [{}] * 3}, size=2)


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param(cases, marks=pytest.mark.numerics(tried, outside="UserError names the array"))
        for tried, cases in CASES.items()
    ],
)
def test_numbers_that_the_schema_does_not_allow(tmp_path, monkeypatch, cases):
    for kind, name, bad in cases:
        with pytest.raises(ArtifactError, match=f"is not written: array '{name}' must be "):
            write(tmp_path, kind, name, bad)
        assert not any(tmp_path.iterdir())
    # As an older version, or another program, writes them.
    for number, (kind, name, bad) in enumerate(cases):
        folder = tmp_path / str(number)
        folder.mkdir()
        with monkeypatch.context() as unchecked:
            unchecked.setattr(Values, "find_fault", lambda *_: "")
            path = write(folder, kind, name, bad)
        with pytest.raises(ArtifactError, match=f"array '{name}'.* must be "):
            open_any(path, SCHEMAS).read(name)
        with pytest.raises(ArtifactError, match=f"array '{name}'.* must be .*Rebuild it"):
            verify(path, SCHEMAS)


@pytest.mark.numerics("NaN for an unknown pose or PSNR; index -1", outside="accepted")
def test_numbers_that_are_not_known(tmp_path):
    unknown = np.tile(np.eye(4), (2, 1, 1))
    unknown[0] = NAN
    path = put(tmp_path, "poses", {"camera_to_world": unknown, "registered": np.array([False, True])})
    np.testing.assert_array_equal(verify(path, SCHEMAS).read("camera_to_world"), unknown)
    path = put(tmp_path, "splats", {"held_out/psnr": np.array([NAN, INF]), "held_out/ssim": np.full(2, NAN)})
    assert np.isnan(verify(path, SCHEMAS).read("held_out/ssim")).all()
    labels = np.full((2, 1, 3, 3), -1, np.int32)
    assert verify(put(tmp_path, "segments", {"labels": labels}), SCHEMAS).row("labels", 1).max() == -1
