"""The rules and the readers of poses have one list of files: a reader needs no file that it lacks."""

import numpy as np
import pytest

from egosplat.poses.adt import adt_poses
from egosplat.poses.options import PosesOptions
from tests.support.recordings import copy_files, opened
from tests.unit.poses.test_adt import CAMERA, MOUNT, cloud

TIMES = np.array([1_010_000_000, 1_015_000_000])


@pytest.mark.parametrize("trajectory", ["closed_loop", "ground_truth"])
def test_the_trajectory_and_the_points_of_the_device_are_read(recording, table, tmp_path, trajectory):
    folder = recording(table, cloud([1e-4], [0.01]), trajectory == "closed_loop")
    listed = opened("poses", "adt", folder, trajectory=trajectory)
    copied = copy_files(listed, folder, tmp_path / "copy")
    whole, alone = (
        adt_poses(one, TIMES, MOUNT, CAMERA, PosesOptions(trajectory=trajectory)) for one in (folder, copied)
    )
    np.testing.assert_array_equal(whole.camera_to_world, alone.camera_to_world)
    np.testing.assert_array_equal(whole.points, alone.points)
    assert len(listed) == 2 and len(whole.points) == 1


def test_colmap_reads_no_file_and_known_poses_theirs(tmp_path):
    (tmp_path / "transforms.json").write_text("{}")
    assert opened("poses", "plain", tmp_path, method="colmap") == []
    assert opened("poses", "plain", tmp_path) == [tmp_path / "transforms.json"]
    assert opened("poses", "adt", tmp_path / "nowhere") == []
