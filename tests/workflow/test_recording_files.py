"""The files of a plain recording are inputs of the rules that read them, so a changed file is noticed."""

import pytest


@pytest.mark.parametrize(
    ("recording", "belongs"), [("pictures", "pictures/"), ("clip.mp4", "clip.mp4.")], ids=["folder", "video"]
)
def test_files_of_a_recording_are_rule_inputs(one_scene, tmp_path, recording, belongs):
    names = ("camera.json", "valid.png", "annotations/instances.tsv", "annotations/0 [1].png")
    files = [tmp_path / f"{belongs}{name}" for name in names]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    (files[-1].parent / "{2}.png").touch()  # Snakemake would take it for a wildcard
    video = [tmp_path / recording] if recording == "clip.mp4" else []
    for file in video:
        file.touch()
    workdir = one_scene("plain", tmp_path / recording)
    done = workdir.snakemake("--dry-run", "--", "results/mine/scene/annotations.zarr")
    assert done.returncode == 0, done.stderr
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines()]
    frames, annotations = [line for line in lines if line.startswith("input: ")]
    assert all(str(path) in frames for path in (*video, *files[:2]))
    assert all(str(path) in annotations for path in (*video, files[2]))
