"""Input of Snakemake: numbers on its command line are numbers."""

from PIL import Image


def test_numbers_of_the_command_line_and_with_an_exponent_are_numbers(one_scene, tmp_path):
    (pictures := tmp_path / "pictures").mkdir()
    for number in range(6):
        Image.new("RGB", (64, 48), (40 * number, 100, 0)).save(pictures / f"{number}.png")
    workdir = one_scene("plain", pictures)
    (workdir.folder / "tiny.yaml").write_text("poses: {meters_per_unit: 1e-4}\n")
    options = ["--config", "frames={stride: 2, upright: false, end_s: null}", "poses={min_registered: 0.7}"]
    target = "results/mine/scene/poses.zarr"
    done = workdir.snakemake("--dry-run", "--printshellcmds", *options, "--", target)
    assert done.returncode == 0, done.stderr
    commands = done.stdout + done.stderr
    for value in ('"stride": 2,', '"upright": false', '"min_registered": 0.7,', '"meters_per_unit": 0.0001,'):
        assert value in commands
    assert '"end_s": null' in commands
