"""VRS files are complete or absent and in order, and the device's calibration is read back as written."""

import struct

import numpy as np
import pytest
from projectaria_tools.core.calibration import device_calibration_from_json_string

from egosplat_apartments.adt_format.aria import (
    RGB_LABEL,
    calibration_json,
    camera_calibration,
    device_from_camera,
)
from egosplat_apartments.adt_format.vrs import ImageStream, create_vrs
from egosplat_apartments.adt_format.vrs_layout import DataLayout

WIDTH, HEIGHT = 20, 12
TAGS = {"device_type": "Aria", "origin": "a test"}


def write(path, times_ns):
    shape = {"image_width": WIDTH, "image_height": HEIGHT, "image_stride": WIDTH * 2}
    stream = ImageStream(345, 1, "Ground Truth Depth Data Class", "", "raw", True, shape)
    with create_vrs(path, TAGS, stream) as file:
        for number, time in enumerate(times_ns):
            exposed = {"frame_number": number, "exposure_s": 0.004, "gain": 1.5}
            file.write_image(bytes(WIDTH * HEIGHT * 2), timestamp_ns=time, **exposed)


def test_record_chain_leads_from_the_header_to_the_end(tmp_path):
    path = tmp_path / "a.vrs"
    write(path, [1000, 2000, 3000])
    content = path.read_bytes()
    magic, header_size, record_header_size, index_at, description_at, first_at = struct.unpack_from(
        "<8s8xIIqqq", content
    )
    assert (magic, header_size, record_header_size) == (b"VisionRe", 80, 32)
    position, before, chain = header_size, 0, []
    while position < len(content):
        size, previous, type_id = struct.unpack_from("<IIi", content, position)
        assert previous == before
        chain.append((position, type_id))
        position, before = position + size, size
    assert position == len(content) and len(chain) == 3 + 1 + 2
    assert (chain[0], chain[1], chain[-1]) == ((description_at, 2), (first_at, 345), (index_at, 1))


def test_records_out_of_order_are_rejected(tmp_path):
    with pytest.raises(ValueError, match="order of time"):
        write(tmp_path / "a.vrs", [2000, 1999])
    assert list(tmp_path.iterdir()) == []


def test_layout_packs_numbers_then_strings():
    layout = DataLayout((("count", "uint32_t"), ("rate", "double")), ("first", "second"))
    packed = layout.pack({"count": 7, "rate": 2.5, "first": "ab", "second": "c"})
    assert struct.unpack("<Id4I3s", packed) == (7, 2.5, 0, 2, 2, 1, b"abc")
    assert np.isnan(struct.unpack_from("<Id", layout.pack({}))[1])


@pytest.mark.parametrize("size", [64, 352, 500, 512, 704, 1408])
def test_calibration_round_trips_through_json(size):
    written = camera_calibration(size)
    read = device_calibration_from_json_string(calibration_json(size)).get_camera_calib(RGB_LABEL)
    assert read.get_image_size().tolist() == [size, size]
    assert read.get_valid_radius() == written.get_valid_radius()
    assert read.get_max_solid_angle() == written.get_max_solid_angle()
    pose = read.get_transform_device_camera().to_matrix()
    np.testing.assert_allclose(pose, device_from_camera(), rtol=0, atol=1e-12)
    axis = np.linspace(0, size - 1, 25)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(grid - written.get_principal_point(), axis=1)
    for pixel in grid[distance <= written.get_valid_radius() - 1e-6]:
        ray = written.unproject_no_checks(pixel)
        np.testing.assert_allclose(read.unproject_no_checks(pixel), ray, rtol=0, atol=1e-9)
        np.testing.assert_allclose(read.project_no_checks(ray), pixel, rtol=0, atol=1e-9 * size)
