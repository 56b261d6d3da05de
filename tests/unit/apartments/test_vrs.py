"""VRS files are complete or absent, in order, and read back bit by bit by projectaria-tools."""

import struct

import numpy as np
import pytest
from projectaria_tools.core import data_provider
from projectaria_tools.core.stream_id import StreamId

from egosplat_apartments.adt_format.vrs import ImageStream, create_vrs
from egosplat_apartments.adt_format.vrs_layout import DataLayout

WIDTH, HEIGHT = 20, 12
TAGS = {"device_type": "Aria", "origin": "a test"}


def raw_stream(instance_id: int, compressed: bool) -> ImageStream:
    configuration = {
        "image_width": WIDTH,
        "image_height": HEIGHT,
        "image_stride": WIDTH * 2,
        "image_pixel_format": 11,
        "nominal_rate": 30.0,
        "description": "214-1",
    }
    return ImageStream(
        345, instance_id, "Ground Truth Depth Data Class", "", "raw", compressed, configuration
    )


def write(path, streams, images, start_ns=10**12):
    with create_vrs(path, TAGS, streams) as file:
        for number, image in enumerate(images):
            file.write_image(
                streams[number % len(streams)],
                image.tobytes(),
                timestamp_ns=start_ns + number * 10**6,
                frame_number=number,
                exposure_s=0.004 + number * 1e-6,
                gain=1.5,
            )


def random_images(count: int) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 2**16, (count, HEIGHT, WIDTH)).astype("<u2")


@pytest.mark.parametrize("compressed", [False, True])
def test_two_streams_come_back_bit_by_bit(tmp_path, compressed):
    images = random_images(7)
    path = tmp_path / "a.vrs"
    write(path, [raw_stream(1, compressed), raw_stream(2, not compressed)], images)
    provider = data_provider.create_vrs_data_provider(str(path))
    assert provider.get_file_tags() == TAGS
    streams = [StreamId("345-1"), StreamId("345-2")]
    assert [provider.get_num_data(stream) for stream in streams] == [4, 3]
    for number, image in enumerate(images):
        data, record = provider.get_image_data_by_index(streams[number % 2], number // 2)
        assert data.to_numpy_array().dtype == np.uint16
        np.testing.assert_array_equal(data.to_numpy_array(), image)
        assert record.capture_timestamp_ns == 10**12 + number * 10**6
        assert record.frame_number == number
        assert (record.exposure_duration, record.gain) == (0.004 + number * 1e-6, 1.5)
    configuration = provider.get_image_configuration(streams[0])
    assert (configuration.image_width, configuration.image_height) == (WIDTH, HEIGHT)
    assert configuration.description == "214-1"


def test_record_chain_leads_from_the_header_to_the_end(tmp_path):
    path = tmp_path / "a.vrs"
    write(path, [raw_stream(1, True)], random_images(3))
    content = path.read_bytes()
    magic, header_size, record_header_size, index_at, description_at, first_at = struct.unpack_from(
        "<8s8xIIqqq", content
    )
    assert magic == b"VisionRe"
    assert (header_size, record_header_size) == (80, 32)
    position, before, chain = header_size, 0, []
    while position < len(content):
        size, previous, type_id = struct.unpack_from("<IIi", content, position)
        assert previous == before
        chain.append((position, type_id))
        position, before = position + size, size
    assert position == len(content)
    assert chain[0] == (description_at, 2)
    assert chain[1] == (first_at, 345)
    assert chain[-1] == (index_at, 1)
    assert len(chain) == 3 + 1 + 2


def test_records_out_of_order_are_rejected(tmp_path):
    stream = raw_stream(1, True)
    image = random_images(1)[0].tobytes()
    options = {"frame_number": 0, "exposure_s": 0.01, "gain": 1.0}
    with (
        pytest.raises(ValueError, match="order of time"),
        create_vrs(tmp_path / "a.vrs", TAGS, [stream]) as file,
    ):
        file.write_image(stream, image, timestamp_ns=2000, **options)
        file.write_image(stream, image, timestamp_ns=1999, **options)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "a.vrs"
    stream = raw_stream(1, False)
    write(path, [stream], random_images(1))
    old = path.read_bytes()
    with pytest.raises(RuntimeError, match="renderer"), create_vrs(path, TAGS, [stream]):
        raise RuntimeError("the renderer died")
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_fields_of_a_layout_are_rejected():
    layout = DataLayout((("count", "uint32_t"), ("rate", "double")), ("name",))
    with pytest.raises(ValueError, match="speed"):
        layout.pack({"speed": 1.0})


def test_layout_packs_numbers_then_strings():
    layout = DataLayout((("count", "uint32_t"), ("rate", "double")), ("first", "second"))
    packed = layout.pack({"count": 7, "rate": 2.5, "first": "ab", "second": "c"})
    assert struct.unpack("<Id4I3s", packed) == (7, 2.5, 0, 2, 2, 1, b"abc")
    assert np.isnan(struct.unpack_from("<Id", layout.pack({}))[1])
