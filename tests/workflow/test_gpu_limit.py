"""On one machine one job at a time uses the GPU, unless the command says otherwise."""

import os
from pathlib import Path

import pytest
from PIL import Image

GPU = "nvidia-smi"


@pytest.mark.parametrize(
    ("programs", "words", "expected"),
    [([GPU], [], 1), ([GPU], ["--resources", "gpu=3"], 3), ([], [], None)],
    ids=["a GPU", "a limit of the user's", "no GPU"],
)
def test_the_number_of_jobs_on_a_gpu(one_scene, tmp_path, monkeypatch, programs, words, expected):
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for number in range(2):
        Image.new("RGB", (64, 48), (number, 0, 0)).save(pictures / f"{number}.png")
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in programs:
        (tools / name).touch(mode=0o755)
    # Without the folders of a machine's own nvidia-smi.
    own = [one for one in os.environ["PATH"].split(os.pathsep) if not Path(one, GPU).exists()]
    monkeypatch.setenv("PATH", os.pathsep.join([str(tools), *own]))
    workdir = one_scene("plain", pictures, "frames.resolution=64 frames.evaluation_frames=0")
    done = workdir.snakemake(*words, "--", "results/mine/scene/frames.zarr")
    assert done.returncode == 0, done.stdout + done.stderr
    (log,) = (workdir.folder / ".snakemake/log").iterdir()
    told = [line for line in log.read_text().splitlines() if line.startswith("Provided resources: ")]
    assert told == ([] if expected is None else [f'Provided resources: gpu=Resource("gpu", {expected})'])
