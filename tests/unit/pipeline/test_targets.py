"""A target that no rule makes is refused with what is meant, and each command that is advised can be read."""

import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.home import make_command
from egosplat.pipeline.results import Rules, check_words

ROOT = Path(__file__).resolve().parents[3]
OUTPUTS = frozenset({"metrics.json", "contact_sheet.png", "frames.zarr"})
MADE = re.compile(r"results/[a-z0-9_]+/[A-Za-z0-9_-]+/(variants/[A-Za-z0-9_-]+/)?(.+)")
RULES = Rules(
    plain=frozenset({"all", "results/benchmark/tables.html"}),
    of_scenes=frozenset({"metrics"}),
    outputs=OUTPUTS,
    is_made=lambda word: bool((found := MADE.fullmatch(word)) and found[2] in OUTPUTS),
)
SCENES = {
    (dataset, scene): SimpleNamespace(results=Path("results", dataset, scene))
    for dataset, scene in (("adt", "scene1"), ("adt", "scene2"), ("mine", "Kitchen"))
}


@pytest.mark.parametrize(
    "word",
    [
        "all",
        "results/benchmark/tables.html",
        "results/adt/scene1/metrics.json",
        "./results/adt/scene1/frames.zarr",
    ],
)
def test_what_a_rule_makes_is_taken(word):
    check_words([word], SCENES, RULES)


@pytest.mark.parametrize(
    "word, meant",
    [
        ("results/ADT/scene1/metrics.json", "did you mean results/adt/scene1/metrics.json?"),
        ("RESULTS/ADT/SCENE2/METRICS.JSON", "did you mean results/adt/scene2/metrics.json?"),
        ("results/adt/scene1/Metrics.json", "did you mean results/adt/scene1/metrics.json?"),
        ("results/adt/scene1/metric.json", "did you mean results/adt/scene1/metrics.json?"),
        (
            "results/adt/scene2/variants/draft/contactsheet.png",
            "results/adt/scene2/variants/draft/contact_sheet.png?",
        ),
        ("results/benchmark/table.html", "did you mean results/benchmark/tables.html?"),
        ("results/adt/scene1", "did you mean results/adt/scene1/metrics.json?"),
        ("adt/scene2/", "did you mean results/adt/scene2/metrics.json?"),
        ("kitchen", "did you mean results/mine/Kitchen/metrics.json?"),
        (
            str(Path("results/adt/scene1/metrics.json").absolute()),
            "did you mean results/adt/scene1/metrics.json?",
        ),
        ("README.md", "targets are files such as results/adt/scene1/metrics.json"),
        ("", "targets are files such as"),
        ("metrics", "is a rule for every scene; give a file, such as"),
        ("-n", "is an option; write it before --"),
        ("--dry-run", "is an option; write it before --"),
    ],
)
def test_a_word_that_no_rule_makes_gets_its_mend(word, meant):
    with pytest.raises(UserError) as caught:
        check_words(["all", word], SCENES, RULES)
    assert meant in str(caught.value) and "\n" not in str(caught.value)


ANYWHERE = 'snakemake --snakefile "$(egosplat snakefile)"'


@pytest.mark.parametrize(
    "place, command",
    [
        ("results/a/b/x.json", f"{ANYWHERE} --cores 2 results/a/b/x.json"),
        ("./results/a/b/x y.json", f"{ANYWHERE} --cores 2 'results/a/b/x y.json'"),
        ("{here}/results/a/b/x.json", f"{ANYWHERE} --cores 2 results/a/b/x.json"),
        ("/else where/results/a/b/x.json", f"cd '/else where' && {ANYWHERE} --cores 2 results/a/b/x.json"),
        ("/results/a/b/x.json", f"cd / && {ANYWHERE} --cores 2 results/a/b/x.json"),
        ("{here}/mine/results/x/y", "cd {here}/mine && snakemake --cores 2 results/x/y"),
        ("/elsewhere/x.json", "run its command again"),
    ],
)
def test_a_result_is_made_from_any_working_directory(place, command, tmp_path, monkeypatch):
    """A folder without a workflow takes the one that comes with egosplat; Snakemake finds a folder's own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine/workflow").mkdir(parents=True)
    (tmp_path / "mine/workflow/Snakefile").write_text("# egosplat")
    command = command.format(here=tmp_path)
    assert make_command(Path(place.format(here=tmp_path))) == command


def test_results_apart_from_the_workflow_are_made_from_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    target = "--directory '/my work' results/a/b/x.json"
    assert make_command(Path("/my work/results/a/b/x.json")) == f"snakemake --cores 2 {target}"
    assert (
        make_command(Path("/my work/results/a/b/x.json"), "--force ")
        == f"snakemake --cores 2 --force {target}"
    )


def advised(program: str) -> set[tuple[str, str]]:
    """Each command of a program in the pages and in the code, with its file; values in braces are filled in."""
    files = [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "config/README.md",
        *(ROOT / "docs").glob("*.md"),
    ]
    found = set()
    for path in [*files, *(ROOT / "src").rglob("*.py"), *(ROOT / "workflow").rglob("*.smk")]:
        text = (
            path.read_text(encoding="utf-8").replace("\\\n", " ").replace('"$(egosplat snakefile)"', "FILE")
        )
        text = re.sub(r"{snakemake_in\([^}]+}", "snakemake", text)
        for line in re.findall(rf"(?:^|[`\"( ]){program} (?=[-\w])[^`\n]*", text, re.MULTILINE):
            found.add((str(path.relative_to(ROOT)), line.strip('`"( ')))
    return found


COMMANDS = sorted(
    (name, line)
    for name, line in advised("snakemake")
    if re.match(r"snakemake -[^\s,]+ [^,]+$", line) and "..." not in line
)


def test_many_commands_are_found():
    assert len(COMMANDS) > 30


@pytest.mark.parametrize("name, line", COMMANDS)
def test_a_command_that_is_advised_can_be_read(name, line):
    """Snakemake's parser takes it, and --config takes no target for a key: Snakemake ends with a traceback."""
    from snakemake.cli import get_argument_parser

    line = (
        re.split(r"(?:  +#|   |[;,.)](?: |$)|\"|')", line)[0]
        if name.endswith((".py", ".smk"))
        else re.split(r"  +#", line)[0]
    )
    words = shlex.split(line.replace("$(CORES)", "2"))
    given = get_argument_parser().parse_args(words[1:])
    assert all("=" in word for word in given.config or [])
    assert all(not target.startswith("-") for target in given.targets)


SHELL = sorted(
    (str(path.relative_to(ROOT)), line.partition("  #")[0].strip())
    for path in [ROOT / "README.md", ROOT / "config/README.md", *(ROOT / "docs").glob("*.md")]
    for block in re.findall(
        r"```sh\n(.*?)```", path.read_text(encoding="utf-8").replace("\\\n", " "), re.DOTALL
    )
    for line in block.splitlines()
    if line.startswith("egosplat ")
)


@pytest.mark.parametrize("name, line", SHELL)
def test_a_command_of_egosplat_in_the_pages_can_be_read(name, line):
    """The command exists and takes its words."""
    from egosplat.cli.commands import cli

    words = shlex.split(re.split(r" [>|&] ", line)[0])[1:]
    context = cli.make_context("egosplat", words)
    command, rest = cli.get_command(context, words[0]), words[1:]
    assert command is not None, words[0]
    command.make_context(words[0], rest, parent=context)
