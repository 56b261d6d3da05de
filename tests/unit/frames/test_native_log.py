"""Messages that C++ libraries write to the process's standard output and error are captured."""

import os

import pytest

from egosplat.frames.native_log import captured_log


def test_important_native_messages_are_kept(capfd):
    with captured_log() as messages:
        os.write(2, b"\x1b[38;2;000;000;255m[VrsDataProvider][INFO]: activated\x1b[0m\n\x1b[0m")
        os.write(2, b"\x1b[38;2;255;000;000m[Reader][ERROR]: Cannot read.\x1b[0m\n")
        os.write(1, b"WARNING: Invalid device version, vrs tag\n")
        os.write(1, b"Corrupt JPEG data\n")
    assert sorted(messages) == ["Corrupt JPEG data", "[Reader][ERROR]: Cannot read."]
    assert capfd.readouterr() == ("", "")


def test_the_descriptors_are_restored_after_an_error(capfd):
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    with pytest.raises(RuntimeError), captured_log() as messages:
        os.write(2, b"why\n")
        raise RuntimeError
    os.write(2, b"after\n")
    assert messages == ["why"]
    assert capfd.readouterr().err == "after\n"
    assert before is None or len(os.listdir("/proc/self/fd")) == before
