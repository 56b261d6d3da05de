"""The files of a recording whose change reruns the stages that read them."""

from egosplat.frames.watched import watched_files


def test_what_exists_is_watched_by_stage(tmp_path):
    """Protects staleness: a stage follows its own files alone, and a missing one is no error."""
    for name in ("video.vrs", "instances.json", "segmentations_2.vrs", "mps/slam/points.csv.gz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    watched = {
        stage: [path.removeprefix(f"{tmp_path}/") for path in watched_files("adt", tmp_path, stage)]
        for stage in ("frames", "annotations", "poses")
    }
    assert watched == {
        "frames": ["video.vrs"],
        "annotations": ["instances.json", "segmentations_2.vrs"],
        "poses": ["mps/slam/points.csv.gz"],
    }


def test_a_video_is_watched_with_its_companion_files(tmp_path):
    """Protects the names of companion files, and names with glob characters or braces."""
    video = tmp_path / "clip [1].mp4"
    for name in ("", ".camera.json", ".annotations/0.png", ".annotations/{2}.png"):
        file = tmp_path / f"{video.name}{name}"
        file.parent.mkdir(exist_ok=True)
        file.touch()
    assert watched_files("plain", video, "frames") == [str(video), f"{video}.camera.json"]
    (tmp_path / f"{video.name}.colmap").mkdir()
    for name in (".colmap/images.bin", ".transforms.json"):
        (tmp_path / f"{video.name}{name}").touch()
    known = {f"{video}.colmap", f"{video}.colmap/images.bin", f"{video}.transforms.json"}
    assert all(known <= set(watched_files("plain", video, stage)) for stage in ("frames", "poses"))
    assert f"{video}.annotations/0.png" in watched_files("plain", video, "annotations")
    assert not [path for path in watched_files("plain", video, "annotations") if "{" in path]
