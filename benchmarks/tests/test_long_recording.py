"""The benchmark of long recordings writes a recording that both stages accept."""

from benchmarks.long_recording.__main__ import run, write_recording


def test_both_stages_run_on_the_recording(tmp_path, capsys):
    """A change of the artifacts must not break the benchmark, which no other test runs."""
    write_recording(tmp_path, 12, 40)
    for stage in ("transient", "splats"):
        run(stage, tmp_path, 40, 3)
        assert float(capsys.readouterr().out.split()[-1]) > 0
        assert (tmp_path / f"{stage}.zarr").exists()
