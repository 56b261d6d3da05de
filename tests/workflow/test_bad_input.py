"""Bad input gives one or two lines with the error and the remedy, and no output is lost; commands that are printed run as they are."""

import os
import re
import shlex
import shutil
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.integrity import check_replaceable
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.frames.video import open_source
from egosplat.models.checkpoints import SAM2, find_checkpoint
from egosplat.pipeline.validation import read_document
from egosplat.run import command
from tests.support import HEADER, ROOT
from tests.support.page_scene import put_looks
from tests.support.scenes import put
from tests.support.warm import warm_plans
from tests.unit.artifacts.test_artifacts import flip
from tests.unit.run.conftest import write_pictures

SCENE, MINE = Path("results/adt/scene1"), Path("results/mine/my_photos")
DESK = "mine\tdesk\tplain\tmy photos\tmodels.set=photos\n"
HOME, PHOTOS = "my work" / SCENE, Path("my work/my photos")
NAME = shlex.quote("""Ann's  "big" $5 `mug`""")
PROGRAMS = f"""
egosplat() {{ test "$*" = snakefile && echo {shlex.quote(str(ROOT / "workflow/Snakefile"))}; }}
magick() {{ shift 3; ls -- "$@"; }}
"""


def bash(line: str) -> str:
    """What a line prints in bash, in which `magick mogrify -OPTION VALUE FILES` lists its files; it has to succeed."""
    words, own = ["bash", "-c", PROGRAMS + line], os.environ | warm_plans()
    done = subprocess.run(words, env=own, check=False, capture_output=True, text=True)
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def finish() -> None:
    os.chdir("my work")
    MINE.parent.mkdir()
    SCENE.rename(MINE)


CLEAR, HUGE = Image.new("RGBA", (8, 6)), Image.new("1", (2**14, 2**14 + 1))
CHECK, RUN, OWN = f"egosplat check '{HOME}'", f"egosplat run '{PHOTOS}'", "egosplat run 'my photos'"
MODELS = "egosplat models --config models.set=light --config 'models.cache=my cache'"
STORY = f"egosplat story '{HOME}/queries.png' --title x --output x.html"
CODES, FRAMES = HOME / "language.zarr", HOME / "frames.zarr"
WORKFLOW, UP = ROOT / "workflow", {"up": np.array([0.0, 2.0, 0.0])}
PLAN = f"cd 'my work' && snakemake -s '{WORKFLOW / 'Snakefile'}' --cores 1 results/mine/desk/frames.zarr"
hurt = partial(flip, CODES / "code/c.0.0.0", -6)
SCORES, PICTURE = HOME / "metrics.json", PHOTOS / "0.png"
PRINTED = [
    # What happens, what tells of it, the command in the text, and what that prints: of a plan a rule.
    (lambda: shutil.rmtree(CODES), f"egosplat query '{HOME}' cup", "scene: (.*)", "language"),
    (dict, f"egosplat view '{HOME}/variants/draft'", "Make the variant: (.*)", "language"),
    (hurt, CHECK, "Rebuild it: (.*)", "language"),
    (lambda: shutil.rmtree(FRAMES), lambda: open_artifact(FRAMES, SCHEMAS["frames"]), "it: (.*)", "frames"),
    (lambda: SCORES.write_text("{"), lambda: read_document(SCORES, "metrics"), "it: (.*)", "metrics"),
    (lambda: [hurt(), Path("workflow").symlink_to(WORKFLOW)], CHECK, "it: (.* --directory .*)", "language"),
    (dict, lambda: put(HOME, "poses", UP), "(egosplat check .*)", "poses.zarr"),
    ((HOME / "queries.png").touch, STORY, "Make it again: (.*)", "queries_sheet"),
    (dict, f"{RUN} --cores 1", "continue yourself: (.*)", "scene_page"),
    (dict, "egosplat --help", "(snakemake --snake.*)", "contact_sheet"),
    (finish, OWN, "  (egosplat query .*?)    ", "couch"),
    (finish, OWN, "  (egosplat view .*?)    ", "shown"),
    (lambda: [finish(), (MINE / "scene.html").write_text("")], OWN, "  (egosplat catalog .*)", "couch"),
    (lambda: put_looks(HOME), f"egosplat name '{HOME}' couch {NAME}", "(egosplat query .*)", "found +1.00"),
    (dict, MODELS, "MB: (egosplat .*)", "my cache/sam2.1_hiera_tiny.pt"),
    (dict, PLAN, "(egosplat models .*)", "checkpoints/sam2.1_hiera_tiny.pt"),
    (dict, lambda: find_checkpoint(SAM2, "my cache/sam2.1_hiera_tiny.pt"), "it: (.*)", "my cache/sam2.1_h"),
    (dict, f"egosplat catalog '{HOME}' --set query.min_score=1", "(egosplat query .*)", "\ncup "),
    (dict, lambda: check_replaceable(HOME / "poses.zarr", SCHEMAS["frames"]), "(rm -r .*)", ""),
    (lambda: CLEAR.save(PICTURE), lambda: open_source(PHOTOS, None).read_opaque(0), "(magick .*)", "/0.png"),
    (lambda: HUGE.save(PICTURE), RUN, "(magick .*)", "my photos/0.png"),
    (lambda: [one.rename(f"{one}.webp") for one in PHOTOS.iterdir()], RUN, "(magick .*)", "0.png.webp"),
]


@pytest.mark.parametrize("happen, tell, pattern, said", PRINTED)
def test_a_command_runs_as_it_is_printed(
    page_scene, tmp_path, monkeypatch, run_command, happen, tell, pattern, said
):
    def told(line: str) -> str:
        egosplat = line.removeprefix("egosplat ")
        return bash(line) if egosplat == line else "\n".join(run_command(*shlex.split(egosplat))[1:])

    monkeypatch.chdir(tmp_path)
    shutil.copytree(page_scene, HOME)
    write_pictures(PHOTOS)
    Path("my work/config").mkdir()
    Path("my work/config/scenes.tsv").write_text(f"{HEADER}adt\tscene1\tadt\t-\tsynthetic.seed=1\n{DESK}")
    monkeypatch.setattr(command, "run_snakemake", lambda words: 0)
    monkeypatch.setattr("egosplat.models.needed.download", lambda files: None)
    monkeypatch.setattr("egosplat.viewing.command.show", lambda *given: print("shown"))
    happen()
    if isinstance(tell, str):
        text = told(tell)
    else:
        with pytest.raises(UserError) as error:
            tell()
        text = str(error.value)
    found = re.search(pattern, text)
    assert found, text
    assert re.search(rf"\n{said} +1\n" if "snakemake " in found[1] else said, told(found[1]))
    assert not found[1].startswith("rm") or not Path(shlex.split(found[1])[2]).exists()


def test_bad_files_of_a_sequence_are_named(finished, run_command, tmp_path):
    def refused(*arguments: object) -> str:
        before = {path for path in tmp_path.rglob("*")}
        status, _, shown = run_command(*arguments)
        assert status == 2 and "Traceback" not in shown, shown
        _, colon, message = shown.rpartition("egosplat: ")  # after lines of progress
        assert colon and len(message.strip().splitlines()) <= 2, shown
        assert {path for path in tmp_path.rglob("*")} == before, "something was left behind"
        return message.replace(f"{tmp_path}/", "")

    scene = Path(shutil.copytree(finished.folder / SCENE, tmp_path / "scene", symlinks=True))
    recording = scene / "recording"
    given = ("--recording", recording, "--output", scene / "new.zarr")
    frames, annotations = ("frames", *given, "--format", "adt"), ("annotations", *given, "--frames")
    video, labels = recording / "video.vrs", recording / "segmentations_with_skeleton.vrs"
    labels.write_bytes(labels.read_bytes()[:-500])
    assert "segmentations_with_skeleton.vrs: cannot be read" in refused(*annotations, scene / "frames.zarr")
    (recording / "instances.json").write_text('{"x": {}}')
    assert "recording/instances.json: " in refused(*annotations, scene / "frames.zarr")
    video.write_bytes(video.read_bytes()[:-500])
    assert "recording/video.vrs: cannot be read " in refused(*frames)
    video.unlink()
    assert "scene/recording: has no video.vrs or recording.vrs" in refused(*frames)
