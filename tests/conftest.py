"""Fixtures of all tests: real recordings, and working directories in which the workflow runs."""

import compileall
import gc
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from egosplat.progress import show_log
from tests.support import ROOT
from tests.support.warm import leave_flushing, run_snakemake, share_servers

REAL_DATA = Path(os.environ.get("EGOSPLAT_REAL_DATA", ROOT.parent / "shared" / "data"))


# A run that chooses its models itself would fetch them; tests have a hub of their own (tests/support/hub.py).
os.environ["HF_HUB_OFFLINE"] = "1"
# Tests read what a user would see.
show_log()
leave_flushing()


def pytest_configure(config: pytest.Config) -> None:
    """Each process of a test run would import PyTorch and Snakemake once more for its stages."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        share_servers()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage among imports and tests, which stay: a sixth of the collection's time, a twentieth of the tests'."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(5000)
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the files of a folder that share what takes long to make on one process; else those of ``--dist loadfile``."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return next(filter(nodeid.startswith, TOGETHER), super()._split_scope(nodeid))

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


TOGETHER = ("tests/unit/apartments/",)


@pytest.fixture(scope="module", autouse=True)
def number_of_threads() -> Iterator[None]:
    """Give PyTorch its number of threads back after each file. numba, which reads .spz files, sets it to the number of cores, and so do
    scripts of training. Several processes with several threads each take ten times as long: threads wait for one another."""
    torch = sys.modules.get("torch")  # not imported for files that do not need it
    before = torch.get_num_threads() if torch else None
    yield
    if torch:
        torch.set_num_threads(before)


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """Return the folder of a real recording by name; the test is skipped if it is absent."""

    def folder(name: str) -> Path:
        path = REAL_DATA / name
        if not path.is_dir():
            pytest.skip(
                f"the real recording {name} is absent; set EGOSPLAT_REAL_DATA to the folder that holds it"
            )
        return path

    return folder


TINY = (ROOT / ".test/config/config.yaml").read_text(encoding="utf-8")
"""The settings of the smallest whole job."""

FEW_SCENES = re.compile(r"^(?:adt\tscene[267]|hoi4d\tscene1|lerf\tfigurines|3d_ovs\tbed)\t.*\n", re.MULTILINE)
"""The rows of the table of scenes that plans read beside the smallest job's: each row takes every plan some more time."""


class Workdir:
    """A working directory with its own copy of configuration and code, in which the workflow runs."""

    PAGES = ("contact_sheet", "instances", "crops", "transient", "splats", "queries")
    MAIN = tuple(
        f"results/adt/scene1/{name}" for name in ("metrics.json", "scene.html", *map("{}.png".format, PAGES))
    )
    """The outputs in ``finished``: scores and every page."""

    snakefile = ROOT / "workflow/Snakefile"

    def __init__(self, folder: Path, code: Path | None = None) -> None:
        self.folder = folder
        self.code = code or folder / "src"

    def options(self, *arguments: object) -> list[str]:
        """Arguments of Snakemake with the tiny settings; options go before ``--``, targets after it. Each job
        has one thread: a job's result then depends neither on the machine nor on other jobs."""
        options = ["--snakefile", self.snakefile, "--cores", "2", "--max-threads", "1"]
        return [str(word) for word in (*options, "--configfile", "tiny.yaml", *arguments)]

    def snakemake(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        """Run Snakemake in the folder."""
        return run_snakemake(self.options(*arguments), self.folder, self.environment)

    def start(
        self, *arguments: object, transcript: Path, before: tuple[str, ...] = ()
    ) -> "subprocess.Popen[bytes]":
        """Start Snakemake in its own process group, with the words ``before`` in front; its output goes to ``transcript``."""
        with transcript.open("w") as said:
            return subprocess.Popen(
                [*before, sys.executable, "-m", "snakemake", *self.options(*arguments)],
                cwd=self.folder,
                env=self.environment,
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def environment(self) -> dict[str, str]:
        """Environment that runs the copied code."""
        return os.environ | {"PYTHONPATH": str(self.code), "PYTHONDONTWRITEBYTECODE": "1"}

    def run(self, *targets: str) -> str:
        """Make targets and return the output; the test fails with the output if a job fails."""
        done = self.snakemake("--", *targets)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def stale(self, *targets: str, config: str = "") -> set[str]:
        """Names of the rules that would run for the targets, with additional configuration."""
        (self.folder / "more.yaml").write_text(config or "{}")
        done = self.snakemake("more.yaml", "--dry-run", "--quiet", "host", "--", *targets)
        assert done.returncode == 0, done.stdout + done.stderr
        output = done.stdout + done.stderr
        found = set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+)", output, re.MULTILINE))
        assert found or "Nothing to be done" in output, output
        return found

    def edges(self, *arguments: object) -> set[tuple[str, str]]:
        """Pairs of rules of a plan, of which the second reads what the first makes."""
        done = self.snakemake(*arguments)
        assert done.returncode == 0, done.stderr
        names = dict(re.findall(r'(\d+)\[label = "([^"\\]+)', done.stdout))
        return {(names[a], names[b]) for a, b in re.findall(r"(\d+) -> (\d+)", done.stdout)}

    def own_code(self) -> Path:
        """The folder of its own copy of the code, which is made when it is first asked for."""
        if self.code != (own := self.folder / "src"):
            self.code = Path(shutil.copytree(self.code, own))
        return own

    def edit(self, module: str, old: str, new: str) -> None:
        """Replace text in its own code; ``module`` is a path below the package egosplat, or begins with another's name."""
        path = self._path(module)
        text = path.read_text()
        assert old in text, f"{module} lacks {old!r}"
        path.write_text(text.replace(old, new, 1))

    def _path(self, module: str) -> Path:
        root = self.own_code()
        return root / module if module.startswith("egosplat_") else root / "egosplat" / module

    @contextmanager
    def edited(self, module: str, old: str, new: str) -> Iterator[None]:
        """``edit``, until the block ends."""
        path = self._path(module)
        before = path.read_bytes()
        self.edit(module, old, new)
        try:
            yield
        finally:
            path.write_bytes(before)


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Workdir:
    """A working directory in which the tiny main job has run; shared by all processes of a test run. Tests
    must not change it; ``workdir`` is a private copy."""
    temporary = tmp_path_factory.getbasetemp()
    shared = temporary if worker_id == "master" else temporary.parent
    folder = shared / "workflow"
    with FileLock(shared / "workflow.lock"):
        if not (folder / "finished").exists():
            shutil.rmtree(folder, ignore_errors=True)
            _run_main_job(folder)
            (folder / "finished").touch()
    return Workdir(folder)


def _run_main_job(folder: Path) -> None:
    shutil.copytree(ROOT / "config", folder / "config")
    tiny, full = ((ROOT / place / "config/scenes.tsv").read_text("utf-8") for place in (".test", ""))
    (folder / "config/scenes.tsv").write_text(tiny + "".join(FEW_SCENES.findall(full)), "utf-8")
    # Every process of a copy would compile its code again. Nothing writes the copy's bytecode when a test edits a file.
    compileall.compile_dir(ROOT / "src", quiet=1)
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("*.egg-info"))
    (folder / "tiny.yaml").write_text(TINY)
    Workdir(folder).run(*Workdir.MAIN)


@pytest.fixture(scope="session")
def unchanged(finished: Workdir, tmp_path_factory: pytest.TempPathFactory) -> Workdir:
    """A copy of the finished run for plans alone."""
    return _copied(finished, tmp_path_factory.mktemp("unchanged"))


@pytest.fixture
def workdir(finished: Workdir, tmp_path: Path) -> Workdir:
    """A private copy of the finished run."""
    return _copied(finished, tmp_path)


def _copied(finished: Workdir, folder: Path) -> Workdir:
    """A copy without the code, which is three quarters of the files and most tests leave as it is."""
    own = shutil.ignore_patterns("src", "finished")
    return Workdir(
        Path(shutil.copytree(finished.folder, folder / "copy", symlinks=True, ignore=own)), finished.code
    )


@pytest.fixture
def one_scene(tmp_path: Path) -> Callable[..., Workdir]:
    """A working directory whose only scene is ``mine/scene``: ``one_scene(format, recording, options)``."""

    def make(format: str, recording: Path, options: str = "") -> Workdir:
        folder = tmp_path / "work"
        (folder / "config").mkdir(parents=True)
        (folder / "config/config.yaml").write_text("{}")
        (folder / "tiny.yaml").write_text("{}")
        header = "dataset\tscene\tformat\trecording\toptions\n"
        row = f"mine\tscene\t{format}\t{recording}\t{options}\n"
        (folder / "config/scenes.tsv").write_text(header + row)
        return Workdir(folder, code=ROOT / "src")

    return make


@pytest.fixture
def run_command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """``run_command(*words)``: a command of ``egosplat`` in this process: exit status, what it printed, and what it complained of."""
    from egosplat import cli

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["egosplat", *map(str, words)])
        status = 0
        try:
            cli.main()
        except SystemExit as end:
            status = int(end.code or 0)
        show_log()  # as before --quiet
        printed = capfd.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.fixture(scope="session")
def clip() -> Any:
    """The bundled OpenCLIP."""
    from egosplat.models.open_clip_loader import load_open_clip

    return load_open_clip("small", "small", "cpu", "float32")


@pytest.fixture(scope="session")
def page_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``results/scene1``: the small scene of the scene page, and its page. Tests must not change it."""
    from tests.support.page_scene import put_page_scene, write_page

    folder = tmp_path_factory.mktemp("page") / "results/scene1"
    folder.mkdir(parents=True)
    put_page_scene(folder)
    write_page(folder)
    return folder


@pytest.fixture(scope="module")
def page_scene_with_histories(page_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``results/adt/scene1``, a copy of the small scene in which a cup is carried."""
    from tests.support.page_scene import put_histories

    folder = tmp_path_factory.mktemp("work")
    put_histories(Path(shutil.copytree(page_scene, folder / "results/adt/scene1")))
    return folder


@pytest.fixture
def work(page_scene_with_histories: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """``page_scene_with_histories``, as the working directory."""
    monkeypatch.chdir(page_scene_with_histories)
    return page_scene_with_histories


@pytest.fixture
def serve() -> Iterator[Callable[..., Any]]:
    """``serve(page, answer, host)``: a ``PageServer`` that runs until the test ends."""
    from egosplat.viewing.server import PageServer

    with ExitStack() as running:

        def make(page: str, answer: Callable[[str], Any], host: str = "127.0.0.1") -> PageServer:
            server = running.enter_context(PageServer(host, 0))
            running.callback(server.shutdown)
            server.offer(page, answer)
            threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
            return server

        yield make
