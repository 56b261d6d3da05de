"""Positions of Gaussians relative to the camera, and extreme and invalid cameras."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.rasterize import cpu
from egosplat.rasterize.api import rasterization
from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.reference import rasterizer as reference
from tests.support.splats import undecided

NEAR = 0.1


def before(depth: float, size: float = 0.1) -> dict[str, object]:
    """A Gaussian near the middle of the image with the same apparent size at any depth [m]."""
    shares = [[0.1 * size, -0.05 * size, 1.0]]
    return {"means": np.multiply(shares, depth), "scales": np.multiply([[size, 2 * size, 1.5 * size]], depth)}


@pytest.mark.numerics(
    "depth of 0.1 m (near plane) to 1e10 m (far plane)", within=1e-5, outside="else: culled"
)
@given(exponent=st.one_of(st.floats(-0.999, 9.999)))
def test_gaussians_at_any_depth(gaussian, compare, measured, exponent):
    measured(compare(gaussian(**before(10.0**exponent)), near_plane=NEAR).error)


@pytest.mark.numerics("depth equal to the near plane", within=1e-5, outside="drawn")
def test_a_gaussian_exactly_at_the_near_plane(gaussian, compare, measured):
    near = float(np.float32(NEAR))
    both = compare(gaussian(means=[[0.0, 0.0, NEAR]], scales=[[0.01, 0.02, 0.015]]), near_plane=near)
    measured(both.error)
    assert both.found.image.any()


@pytest.mark.numerics(
    "depth just below the near plane, 1e-30 m, 0, negative", outside="culled: radius and gradient 0"
)
@pytest.mark.parametrize(
    "depth", [np.nextafter(np.float32(NEAR), np.float32(0)), 1e-30, 0.0, -1e-30, -NEAR, -2.0]
)
def test_gaussians_in_front_of_the_near_plane_are_culled(gaussian, compare, depth):
    near = float(np.float32(NEAR))
    found = compare(gaussian(means=[[0.01, 0.0, depth]]), near_plane=near).found
    assert not found.image.any() and not found.meta["radii"].any()
    assert not any(gradient.any() for gradient in found.gradients.values())


@pytest.mark.numerics(
    "near plane of 1e-12 to 1e3 m, a Gaussian on it", within=1e-5, outside="0 or less: ValueError"
)
@given(exponent=st.floats(-12, 3))
def test_any_near_plane(gaussian, compare, measured, exponent):
    near = 10.0**exponent
    measured(compare(gaussian(**before(1.01 * near)), near_plane=near).error)


@pytest.mark.numerics(
    "focal length of 1 to 1e5 px, Gaussian of 0.01 to 1e4 px",
    within=2e-5,
    outside="focal length 0, negative, not finite: ValueError",
)
@given(exponent=st.floats(0, 5), wide=st.floats(-2, 4))
def test_any_focal_length(gaussian, compare, measured, exponent, wide):
    focal, size = 10.0**exponent, 10.0 ** (wide - exponent)
    K = [[[focal, 0, 16.0], [0, 1.1 * focal, 12.0], [0, 0, 1]]]
    both = compare(
        gaussian(means=[[2 / focal, -3 / focal, 2.0]], scales=[[size, 2 * size, 1.5 * size]], Ks=K)
    )
    measured(both.error)


@pytest.mark.numerics(
    "expected depth: focal length of 1 to 1e5 px, alpha of 0.05 to 1",
    within=2e-5,
    outside="no Gaussian: depth 0",
)
@pytest.mark.parametrize("focal", [1.0, 10.0, 1e3, 1e5])
def test_expected_depth_at_any_distance(gaussian, compare, measured, focal):
    K = [[[focal, 0, 16.0], [0, focal, 12.0], [0, 0, 1]]]
    both = compare(gaussian(scales=[[1.0, 2.0, 1.5]], Ks=K), render_mode="RGB+ED")
    image = both.found.image.double()
    covered = both.truth.image[..., -1] > 0.05
    assert covered.any() and image.isfinite().all() and not image[both.found.image[..., -1] == 0].any()
    measured(float((image - both.truth.image)[covered & both.decided].abs().max()))


@pytest.mark.numerics(
    "Gaussian beside the image by 1 to 1e8 times its distance, and as wide",
    within=1e-5,
    outside="linearized at 1.3 times the field of view",
)
@given(exponent=st.floats(0, 8))
def test_gaussians_next_to_the_image(gaussian, compare, measured, exponent):
    aside = 2 * 10.0**exponent
    measured(compare(gaussian(means=[[aside, 0.0, 2.0]], scales=[[aside, 0.2, aside]])).error)


@pytest.mark.numerics("image of 1x1 px, focal length of 1 to 1e5 px", within=1e-5, outside="0 px: ValueError")
@pytest.mark.parametrize("focal", [1.0, 30.0, 1e5])
def test_an_image_of_one_pixel(gaussian, compare, measured, focal):
    K = [[[focal, 0, 0.4], [0, focal, 0.7], [0, 0, 1]]]
    both = compare(gaussian(means=[[0.0, 0.0, 2.0]], opacities=[0.6], Ks=K), 1, 1)
    assert both.found.image.shape == (1, 1, 4) and both.found.image.any()
    measured(both.error)


@pytest.mark.numerics("images of 1x40, 40x1 and 17x33 px", within=1e-5)
@pytest.mark.parametrize(("width", "height"), [(1, 40), (40, 1), (17, 33)])
def test_narrow_images(gaussian, compare, measured, width, height):
    measured(compare(gaussian(scales=[[1.0, 2.0, 1.5]]), width, height).error)


@pytest.mark.numerics(
    "camera and Gaussian 1 to 1e6 m from the origin", within=1e-5, outside="float32 resolves 6 cm at 1e6 m"
)
@given(exponent=st.floats(0, 6), turn=st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_camera_far_from_the_origin(gaussian, compare, measured, exponent, turn):
    center = np.array([1.0, -0.5, 0.3]) * 10.0**exponent
    view = np.eye(4)
    view[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    view[:3, 3] = -view[:3, :3] @ center
    mean = view[:3, :3].T @ [0.03, -0.02, 2.0] + center
    measured(compare(gaussian(means=[mean], viewmats=view[None])).error)


@pytest.mark.numerics(
    "focal length 0, -1, NaN; pose with NaN or infinity; near plane 0 or beyond the far plane; image of 0 px",
    outside="ValueError names the argument",
)
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"Ks": [[[0.0, 0, 1], [0, 1, 1], [0, 0, 1]]]}, "focal lengths must be positive"),
        ({"Ks": [[[-1.0, 0, 1], [0, 1, 1], [0, 0, 1]]]}, "focal lengths must be positive"),
        ({"Ks": [[[math.nan, 0, 1], [0, 1, 1], [0, 0, 1]]]}, "not finite"),
        ({"viewmats": np.full((1, 4, 4), math.inf)}, "not finite"),
        ({"near_plane": 0.0}, "near_plane"),
        ({"near_plane": math.nan}, "near_plane"),
        ({"near_plane": 2.0, "far_plane": 1.0}, "near_plane"),
        ({"eps2d": math.nan}, "eps2d"),
        ({"width": 0}, "0 x 4 pixels"),
    ],
    ids=str,
)
def test_invalid_cameras_are_rejected(gaussian, changes, words):
    tensors = {name: value for name, value in changes.items() if name in ("Ks", "viewmats")}
    numbers = {"width": 4, "height": 4} | {name: changes[name] for name in changes.keys() - tensors.keys()}
    with pytest.raises(ValueError, match=words):
        rasterization(**gaussian(**tensors), **numbers)


@pytest.mark.numerics(
    "the reference in float32: image of 40 Gaussians",
    within=1e-5,
    outside="culled: variance above 1e19 px², quaternion length below 1e-19 or above 1e19",
)
@pytest.mark.parametrize("seed", range(3))
def test_reference_in_float32(cloud, measured, seed):
    values = cloud(seed, 40)
    results = []
    for dtype in (torch.float32, torch.float64):
        given_ = {name: value.to(dtype) for name, value in values.items()}
        results.append(reference.rasterization(Arguments(**given_, width=32, height=24)))
    (found, found_alpha, _), (truth, truth_alpha, meta) = results
    decided = ~undecided(meta)[0]
    measured(float(((found - truth)[0].abs() * decided[..., None]).max()))
    measured(float(((found_alpha - truth_alpha)[0].abs() * decided[..., None]).max()))


@pytest.mark.numerics("float64 arguments", outside="kernels reject them; auto takes the reference")
def test_float64_is_rendered_by_the_reference(gaussian):
    values = {name: value.double() for name, value in gaussian().items()}
    assert rasterization(**values, width=4, height=4)[0].dtype == torch.float64
    with pytest.raises(UserError, match="float32"):
        cpu.rasterization(Arguments(**values, width=4, height=4))
