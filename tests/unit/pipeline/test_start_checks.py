"""The workflow rejects impossible runs before Snakemake begins."""

import getpass
import os

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import check_config_files
from egosplat.pipeline.process_guards import check_cores, name_user


@pytest.mark.parametrize(
    "cores, nodes, named", [(0, None, "--cores 0"), (-2, None, "--cores -2"), (None, 0, "--jobs 0")]
)
def test_no_cores_and_no_jobs_are_rejected(cores, nodes, named):
    check_cores(1, None)
    check_cores(None, 1)
    with pytest.raises(UserError, match=named):
        check_cores(cores, nodes)


def test_each_configuration_file_is_checked_and_json_is_left_to_snakemake(tmp_path):
    good, bad, json = tmp_path / "good.yaml", tmp_path / "bad.yaml", tmp_path / "c.json"
    good.write_text("frames: {stride: 2}")
    json.write_text('{\t"frames": {}}')
    check_config_files([good, json])
    bad.write_text("frames: {}\nframes: {}\n")
    with pytest.raises(UserError, match="bad.yaml"):
        check_config_files([good, bad])


def test_a_user_without_a_name_gets_a_number(monkeypatch):
    """Snakemake asks for a name, and a container's user has none."""

    def unknown() -> str:
        raise KeyError("getpwuid(): uid not found")

    monkeypatch.setenv("USER", "me")
    name_user()
    assert os.environ["USER"] == "me"
    monkeypatch.setattr(getpass, "getuser", unknown)
    name_user()
    assert os.environ["USER"] == str(os.getuid())
