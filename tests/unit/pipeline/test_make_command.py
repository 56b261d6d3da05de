"""Commands in messages work where the user is."""

from pathlib import Path

import pytest

from egosplat.pipeline.make_command import make_command


@pytest.mark.parametrize(
    "path, command",
    [
        ("results/a/b/x.zarr", "snakemake --cores 2 results/a/b/x.zarr"),
        ("../there/results/a/b/x.zarr", "snakemake --cores 2 --directory ../there results/a/b/x.zarr"),
        ("/my work/results/a/b/x.zarr", "snakemake --cores 2 --directory '/my work' results/a/b/x.zarr"),
        (
            "results/work/results/a/b/x.zarr",
            "snakemake --cores 2 --directory results/work results/a/b/x.zarr",
        ),
    ],
)
def test_targets_are_relative_to_their_working_directory(path, command):
    assert make_command(Path(path)) == command
    assert make_command(Path.cwd() / "results/a/b/x.zarr") == "snakemake --cores 2 results/a/b/x.zarr"
