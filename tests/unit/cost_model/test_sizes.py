"""The sizes of a scene come from its artifacts' headers, and are read only when a law needs them."""

import copy
from pathlib import Path

import pytest
import zarr

from egosplat.cost_model.sizes import _IN_ARTIFACTS, Sizes
from egosplat.pipeline.config import defaults, merge
from egosplat.survey.motion import SIDE

ARRAYS = {
    "frames.zarr/rgb": (7, 20, 30, 3),
    "instances.zarr/labels": (7, 3, 20, 30),
    "instances.zarr/instances/level": (11,),
    "view_features.zarr/feature": (40, 512),
    "features.zarr/code": (11, 5),
    "splats.zarr/means": (900, 3),
}


@pytest.fixture
def artifacts(tmp_path: Path) -> list[str]:
    """Artifacts with the arrays of a scene, without values."""
    for path, shape in ARRAYS.items():
        store, _, name = path.partition("/")
        zarr.open_group(tmp_path / store, mode="a").create_array(name, shape=shape, dtype="u1")
    return [str(tmp_path / store) for store in dict.fromkeys(path.partition("/")[0] for path in ARRAYS)]


def frames_with(folder: Path, device_from_camera: object) -> str:
    """Path of a frames artifact with this fact."""
    path = folder / "frames.zarr"
    facts = {"device_from_camera": device_from_camera}
    zarr.open_group(path, mode="a").attrs["egosplat"] = {"facts": facts}
    return str(path)


def test_sizes_are_those_of_the_arrays(artifacts):
    """A job asks by what its inputs hold; other files among them are ignored."""
    scene = Sizes(defaults(), [*artifacts, "somewhere/trajectory.csv", "results/poses.csv"])
    assert (scene["frames"], scene["pixels"]) == (7, 600)
    assert [scene[name] for name in ("instances", "views", "channels", "gaussians")] == [11, 40, 512, 900]
    assert scene["codes"] == 15


def test_labels_have_the_frames_size_as_well(artifacts):
    """Jobs that read instances but no frames know the size too."""
    scene = Sizes(defaults(), artifacts[1:2])
    assert (scene["frames"], scene["pixels"]) == (7, 600)


def test_an_input_that_is_not_made_yet_is_named(artifacts, tmp_path):
    """Snakemake shows <TBD> for a FileNotFoundError whose filename is one of the job's inputs."""
    later = str(tmp_path / "later" / "frames.zarr")
    with pytest.raises(FileNotFoundError) as raised:
        _ = Sizes(defaults(), [later])["pixels"]
    assert raised.value.filename == later


def test_a_size_that_nothing_tells_is_no_missing_file(tmp_path):
    """A rule without the needed input is an error, not a <TBD>."""
    with pytest.raises(LookupError, match="frames"):
        _ = Sizes(defaults(), [str(tmp_path / "poses.zarr")])["frames"]


def test_given_sizes_come_first(artifacts):
    """doctor and docs/running.md set sizes that no artifact has yet."""
    assert Sizes(defaults(), artifacts, {"frames": 99})["training"] == 99


def test_the_configuration_limits_what_is_not_known():
    """Budgets stand for sizes that no input has; memory is asked for as if all were used."""
    keys = {"prompting": "key_frames", "max_instances": 400}
    config = merge(defaults(), {"segments": keys, "splats": {"max_gaussians": 5}})
    assert Sizes(config, at_most=True)["tracked"] == 1200
    assert Sizes(config)["tracked"] < 1200
    assert Sizes(config)["gaussians"] == 5
    config["segments"]["max_instances"] = 2
    assert Sizes(config)["tracked"] == Sizes(config, at_most=True)["tracked"] == 6


def test_only_what_moves_is_tracked_where_single_frames_are_segmented():
    """Tracks took most of the time of segments. The preset draft has none, tracks of everything are many."""
    sizes = {
        name: Sizes(merge(defaults(), {"segments": keys}), given={"frames": 120})
        for name, keys in {
            "none": {"track_moving": "never"},
            "moving": {"track_moving": "auto"},
            "all": {"prompting": "key_frames"},
        }.items()
    }
    assert sizes["none"]["tracked"] == sizes["none"]["moving"] == 0
    assert 0 < sizes["moving"]["tracked"] == sizes["moving"]["moving"] <= 20 < sizes["all"]["tracked"]
    assert sizes["none"]["instances"] == sizes["moving"]["instances"], (
        "masks are merged into instances all the same"
    )


def test_tracks_and_masks_of_frames_are_not_merged():
    """Then instances are copied, and each mask of a frame is an instance that one frame shows."""
    frames = {"frames": 120, "pixels": 512**2}
    tracks = Sizes(merge(defaults(), {"segments": {"prompting": "key_frames"}}), given=frames)
    masks = Sizes(merge(defaults(), {"instances": {"source": "tracks"}}), given=frames)
    classical = Sizes(merge(defaults(), {"segments": {"segmenter": "classical"}}), given=frames)
    merged = Sizes(defaults(), given=frames)
    for name in ("merging_iterations", "merging_pixels", "merging_gaussians", "masks", "merged_views"):
        assert tracks[name] == masks[name] == classical[name] == 0 < merged[name], name
    assert classical["labeled"] == classical["kept"], (
        "the classical segmenter tracks, whatever prompting says"
    )
    assert masks["views"] == masks["instances"] > 5 * merged["instances"]


def test_prompts_by_depth_are_many_in_the_frame_alone():
    """GAGS prompts no crops; SAM2 then takes twice the time of a grid and its crops (docs/methods.md)."""
    grid, depth = (
        Sizes(merge(defaults(), {"segments": {"point_prompts": kind}}), given={"kept": 100})
        for kind in ("grid", "depth")
    )
    assert depth["images"] < grid["images"] and depth["prompts"] > 2 * grid["prompts"]


def test_codes_of_whole_features_are_as_long_as_these():
    """Methods of others learn features that nothing compresses."""
    whole = Sizes(merge(defaults(), {"features": {"compression": "none"}}))
    assert whole["codes"] == 3 * whole["channels"] > Sizes(defaults())["codes"]


def test_poses_come_from_colmap_where_the_recording_has_no_trajectory(tmp_path):
    """The cost model decides as the stage poses does."""
    auto, forced = defaults(), copy.deepcopy(defaults())
    forced["poses"]["method"] = "colmap"
    with_trajectory = frames_with(tmp_path / "a", [[1.0]])
    without = frames_with(tmp_path / "b", None)
    assert not Sizes(auto, [with_trajectory]).colmap
    assert Sizes(auto, [without]).colmap
    assert Sizes(forced, [with_trajectory]).colmap


def test_a_sam2_configuration_that_cannot_be_read_counts_as_a_published_one(tmp_path):
    """The stage itself reports the error; the request must not."""
    config = copy.deepcopy(defaults())
    config["models"]["sam2_config"] = str(tmp_path / "none.yaml")
    assert Sizes(config)["sam2_area"] == 1.0


def test_the_survey_compares_frames_of_its_own_size():
    """The cost model repeats the survey's constant, for it imports no stage."""
    assert Sizes(defaults(), given={"pixels": 1e9})["surveyed_pixels"] == SIDE**2


def test_the_headers_are_those_of_the_schemas():
    """A renamed or transposed array of an artifact must be renamed here."""
    from egosplat.artifacts.registry import SCHEMAS

    names = {
        "frames": {"frame"},
        "pixels": {"height", "width"},
        "points": {"point"},
        "instances": {"instance"},
        "views": {"view"},
        "channels": {"channel"},
        "gaussians": {"gaussian"},
    }
    for size, sources in _IN_ARTIFACTS.items():
        for artifact, array, axes in sources:
            dims = set(SCHEMAS[artifact].fields[array].dims[axes])
            assert dims == names.get(size, dims) and len(dims) == axes.stop - axes.start, (size, artifact)
