"""egosplat as a package: built as a packager does, installed outside of the repository, used in an empty folder."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from egosplat.rasterize.kernels.targets import VARIANTS
from egosplat_apartments.rays.library import LIBRARY
from tests.support import ROOT

pytestmark = pytest.mark.slow

TARGET = "results/adt/scene1/metrics.json"

# In the repository, but no part of the distributions.
LEFT_OUT = ("tests", "benchmarks", "training", "docs", "containers", "packaging")
LIBRARIES = [f"egosplat/rasterize/kernels/{variant.file}" for variant in VARIANTS]
LIBRARIES += [f"egosplat_apartments/rays/{LIBRARY}"]


def run(*words: str | Path, cwd: Path, path: str = "") -> subprocess.CompletedProcess[str]:
    """Run a program without this checkout on the path of Python."""
    env = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "EGOSPLAT_"))}
    env |= {"PATH": f"{path}:{env['PATH']}", "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.run([*map(str, words)], cwd=cwd, env=env, capture_output=True, text=True, check=False)


def ensure(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def tracked(*folders: str) -> set[str]:
    """Files of the repository that git tracks or would."""
    words = ("git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *folders)
    names = ensure(run(*words, cwd=ROOT)).splitlines()
    return {name for name in names if (ROOT / name).is_file()}


def build(source: Path, kind: str, output: Path) -> Path:
    ensure(run(sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", output, cwd=source))
    (made,) = output.iterdir()
    return made


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution of the files that git knows."""
    copy = tmp_path_factory.mktemp("checkout")
    for name in tracked(".", *(f":!{folder}" for folder in LEFT_OUT)):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, copy / name)
    return build(copy, "sdist", tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built from the source distribution."""
    folder = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (source,) = folder.iterdir()
    # Libraries that were compiled from the same sources are kept, which saves a minute.
    built = source / f"build/lib.{sysconfig.get_platform()}-{sys.implementation.cache_tag}"
    for name in LIBRARIES:
        if (ROOT / "src" / name).is_file():
            (built / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / "src" / name, built / name)
    return build(source, "wheel", tmp_path_factory.mktemp("wheel"))


class Installed:
    """A Python environment with the wheel. Its other libraries are those of the environment that runs the tests."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        venv.create(folder)
        self.bin = folder / "bin"
        code = "import site; print(*site.getsitepackages())"
        self.site = Path(ensure(run(self.bin / "python", "-c", code, cwd=folder)).strip())
        (self.site / "shared.pth").write_text(sysconfig.get_path("purelib"))
        (self.bin / "snakemake").write_text(f'#!/bin/sh\nexec {self.bin}/python -m snakemake "$@"\n')
        (self.bin / "snakemake").chmod(0o755)
        pip = (sys.executable, "-m", "pip", "--python", self.bin / "python", "install")
        ensure(run(*pip, "--no-deps", "--no-index", wheel, cwd=folder))

    def call(self, *words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
        return run(self.bin / str(words[0]), *words[1:], cwd=cwd, path=str(self.bin))

    def files(self) -> dict[Path, float]:
        return {path: path.stat().st_mtime for path in self.site.rglob("*")}


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Installed]:
    """The wheel in an environment, in whose folders nothing is written: they may be read-only."""
    found = Installed(tmp_path_factory.mktemp("environment"), wheel)
    before = found.files()
    yield found
    assert found.files() == before


def test_the_wheel_holds_the_package_and_the_workflow(wheel):
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    package = {name.removeprefix("src/") for name in tracked("src")}
    copied = {name for name in tracked("workflow", "config") if not name.endswith(".md")}
    shipped = {f"egosplat/shipped/{name}" for name in copied}
    compiled = {name for name in LIBRARIES if (ROOT / "src" / name).is_file()}
    assert names == package | shipped | compiled
    assert re.search(r"-py3-none-linux_\w+\.whl$", wheel.name)


def test_both_distributions_hold_the_licenses_and_links_open_anywhere(sdist, wheel):
    with tarfile.open(sdist) as archive:
        source = {name.partition("/")[2] for name in archive.getnames()}
    licenses = {path.name for path in [*ROOT.glob("LICENSE*"), *ROOT.glob("NOTICE*")]}
    assert licenses | {"CITATION.cff", "CHANGELOG.md"} <= source
    assert not {name.partition("/")[0] for name in source} & set(LEFT_OUT)
    inside = zipfile.ZipFile(wheel).namelist()
    assert licenses == {name.partition("/licenses/")[2] for name in inside if "/licenses/" in name}
    (about,) = [name for name in inside if name.endswith("/METADATA")]
    assert not re.search(r"\]\((?!https:)", zipfile.ZipFile(wheel).read(about).decode())


def test_an_empty_folder_is_enough(installed, tmp_path):
    """The library, the command line, and the plan of a whole scene by the command that a message advises."""
    where = "import egosplat, egosplat_apartments; print(egosplat.open_scene.__module__, egosplat.__file__)"
    assert str(installed.site) in ensure(installed.call("python", "-c", where, cwd=tmp_path))
    assert "snakefile" in ensure(installed.call("egosplat", "--help", cwd=tmp_path))
    snakefile = Path(ensure(installed.call("egosplat", "snakefile", cwd=tmp_path)).strip())
    assert snakefile.is_relative_to(installed.site)
    refused = installed.call("egosplat", "query", "results/adt/scene1", "cup", cwd=tmp_path).stderr
    command = re.search(r"snakemake .*", refused)[0]
    assert command.startswith('snakemake --snakefile "$(egosplat snakefile)" --cores 2 results/adt/scene1/f')
    planned = run("sh", "-c", f"{command} --dry-run", cwd=tmp_path, path=str(installed.bin))
    assert re.search(r"^synthetic +1$", ensure(planned), re.MULTILINE)
    assert {path.name for path in tmp_path.iterdir()} == {".snakemake"}


def test_doctor_finds_everything(installed, sdist, tmp_path):
    """The configuration, the kernels, the small checkpoints and the table of scenes come with the package.
    The remedy for missing kernels names the source distribution."""
    report = ensure(installed.call("egosplat", "doctor", cwd=tmp_path))
    assert f"{installed.site}/egosplat/shipped/config/config.yaml" in "".join(report.split())
    if all((ROOT / "src" / name).is_file() for name in LIBRARIES):
        assert re.search(r"^ok +kernels", report, re.MULTILINE)
    code = "from egosplat.pipeline.home import how_to_reinstall; print(how_to_reinstall())"
    assert ensure(installed.call("python", "-c", code, cwd=tmp_path)).split()[-1] == sdist.name


def test_the_folders_own_configuration_wins(installed, tmp_path):
    (tmp_path / "config").mkdir()
    (tmp_path / "config/config.yaml").write_text("preset: draft\n")
    rows = (ROOT / "config/scenes.tsv").read_text().splitlines()
    (tmp_path / "config/scenes.tsv").write_text(f"{rows[0]}\n{rows[1].replace('scene1', 'flat')}\n")
    assert "preset draft (config/config.yaml)" in ensure(installed.call("egosplat", "doctor", cwd=tmp_path))
    snakefile = ensure(installed.call("egosplat", "snakefile", cwd=tmp_path)).strip()
    other = installed.call("snakemake", "--snakefile", snakefile, "--dry-run", TARGET, cwd=tmp_path)
    assert other.returncode and "take one of: adt/flat" in other.stderr
