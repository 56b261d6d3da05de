"""Ray casting: hits are correct, and equal to the last bit however the caster is compiled."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from compiling import compile_rays, find_compiler
from egosplat.errors import UserError
from egosplat_apartments.objects.shapes import sheet
from egosplat_apartments.rays import library
from egosplat_apartments.rays.triangles import Triangles

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
HALVES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def random_triangles_and_rays():
    rng = np.random.default_rng(1)
    corners = rng.uniform(-2, 2, (700, 1, 3)) + rng.normal(0, 0.3, (700, 3, 3))
    faces = np.arange(2100, dtype=np.int32).reshape(-1, 3)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = rng.uniform(-3, 3, (3000, 3)).astype(np.float32), directions.astype(np.float32)
    return (corners.reshape(-1, 3).astype(np.float32), faces), rays


def rolling_ground():
    flat = sheet((0, 0, 0), (4, 0, 0), (0, 0, 4), step=0.1)
    heights = np.random.default_rng(3).uniform(0, 0.05, len(flat.vertices))
    return (flat.vertices + np.outer(heights, [0, 1, 0])).astype(np.float32), flat.faces.astype(np.int32)


def rays_at_edges(count):
    rng = np.random.default_rng(4)
    vertices, faces = rolling_ground()
    chosen = vertices[faces[rng.integers(len(faces), size=count)]]
    share = rng.choice([0.0, 0.25, 0.5, 0.3], size=(count, 1))
    targets = ((1 - share) * chosen[:, 0] + share * chosen[:, 1]).astype(np.float32)
    origins = rng.uniform([0, 1, 0], [4, 2, 4], (count, 3)).astype(np.float32)
    return origins, targets - origins


def one_by_one(vertices, faces, origins, directions):
    corners, directions = vertices.astype(np.float64)[faces], directions.astype(np.float64)
    sides = (corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -directions[:, None])
    way = origins.astype(np.float64)[:, None] - corners[:, 0]
    matrix = np.stack(np.broadcast_arrays(*sides), axis=-1)
    u, v, distance = np.moveaxis(np.linalg.solve(matrix, way[..., None])[..., 0], -1, 0)
    distance[(u < 0) | (v < 0) | (u + v > 1) | (distance <= 0)] = np.inf
    face = distance.argmin(axis=1)
    chosen = np.arange(len(face)), face
    return np.where(np.isfinite(distance[chosen]), face, -1), distance[chosen], u[chosen], v[chosen]


def test_hits_equal_those_of_testing_every_triangle():
    triangles, rays = random_triangles_and_rays()
    face, distance, u, v = Triangles(*triangles).cast(*rays)
    expected = one_by_one(*triangles, *rays)
    np.testing.assert_array_equal(face, expected[0])
    hit = face >= 0
    assert 0.3 < hit.mean() < 1
    np.testing.assert_allclose(distance[hit], expected[1][hit], rtol=1e-6)
    np.testing.assert_allclose(np.stack([u, v])[:, hit], np.stack(expected[2:])[:, hit], atol=1e-6)
    assert np.isinf(distance[~hit]).all()
    # What is hit nearer than a limit blocks.
    for factor, blocked in ((1.001, True), (0.999, False)):
        reach = np.where(hit, distance * factor, 100).astype(np.float32)
        np.testing.assert_array_equal(Triangles(*triangles).blocks(*rays, reach), hit & blocked)


def test_no_ray_passes_between_two_triangles():
    square = Triangles(SQUARE, HALVES)
    share = np.linspace(0, 1, 1001, dtype=np.float32)
    targets = np.stack([share, share, np.zeros_like(share)], axis=1)
    for origin in ([0.3, 0.9, 1.7], [-0.2, 0.1, -0.9]):
        origin = np.array(origin, dtype=np.float32)
        # Rounding moves the ends outwards.
        assert (square.cast(origin, targets - origin)[0] >= 0).mean() > 0.99
        assert (square.cast(origin, targets[1:-1] - origin)[0] >= 0).all()
    straight = np.tile(np.array([0, 0, -1], dtype=np.float32), (len(targets), 1))
    face, distance, _, _ = square.cast(targets + np.array([0, 0, 2], dtype=np.float32), straight)
    assert (face == 0).all() and (distance == 2).all()


@pytest.mark.parametrize("flags", ["-O0", "-O2 -march=x86-64", "-O3 -march=native", "-O3 -march=x86-64-v3"])
def test_equal_to_the_last_bit_however_it_is_compiled(flags, tmp_path, monkeypatch):
    if find_compiler() is None:
        pytest.skip("no C++ compiler is found")
    monkeypatch.setenv("CXXFLAGS", flags)
    shutil.copytree(library.HERE / "source", tmp_path / "source")
    try:
        compile_rays(tmp_path, tmp_path)
    except RuntimeError as error:
        pytest.skip(f"the compiler refuses {flags}: {error}")
    if "v3" in flags and "fma" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("the processor lacks AVX2")
    other = library.open_library(tmp_path / library.LIBRARY)
    triangles, rays = rolling_ground(), rays_at_edges(20_000)
    ours, theirs = (Triangles(*triangles, library=made).cast(*rays) for made in (None, other))
    for one, two in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one.view(np.uint32), two.view(np.uint32))


def test_rays_beyond_all_triangles_hit_nothing():
    empty = Triangles(np.empty((0, 3), np.float32), np.empty((0, 3), np.int32))
    rays = np.zeros((5, 3), np.float32), np.ones((5, 3), np.float32)
    assert (empty.cast(*rays)[0] == -1).all()
    assert not empty.blocks(*rays, np.full(5, np.inf, dtype=np.float32)).any()


def test_faces_with_missing_vertices_are_rejected():
    with pytest.raises(ValueError, match="0 to 4 of 4"):
        Triangles(SQUARE, np.array([[0, 1, 4]], dtype=np.int32))
    with pytest.raises(ValueError, match="2 origins for 1"):
        Triangles(SQUARE, HALVES).cast(np.zeros((2, 3), np.float32), np.ones((1, 3), np.float32))


def test_a_library_that_is_missing_or_of_other_sources_is_an_error(monkeypatch):
    for name, value, error in (
        ("source_hash", lambda: "0" * 16, "other sources.*make install"),
        ("HERE", Path("nowhere"), "apt install g"),
    ):
        library.load.cache_clear()
        with monkeypatch.context() as patch, pytest.raises(UserError, match=error):
            patch.setattr(library, name, value)
            library.load()
    library.load.cache_clear()


def test_without_a_compiler_a_library_of_other_sources_is_removed(tmp_path, monkeypatch):
    shutil.copytree(library.HERE / "source", tmp_path / "source")
    (tmp_path / library.LIBRARY).write_bytes(b"of older sources")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CXX", "")
    (note,) = compile_rays(tmp_path, tmp_path)
    assert "apt install g++" in note
    assert not (tmp_path / library.LIBRARY).exists()
