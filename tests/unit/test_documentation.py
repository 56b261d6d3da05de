"""The pages for people: their links open, they name every page, and they agree with the code."""

import io
import re
import tokenize
from pathlib import Path

import pytest
import yaml

import egosplat
from egosplat.alarms.table import TABLE
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.pipeline.config import section_keys, section_options
from egosplat.pipeline.stages import PIPELINE, STAGES
from tests.support import ROOT

FOLDERS = ("docs", "config", "benchmarks", "training", "src")
PAGES = sorted([*ROOT.glob("*.md"), *(page for name in FOLDERS for page in (ROOT / name).rglob("*.md"))])
TEXTS = {".md", ".py", ".yaml", ".smk", ".rst", ".tsv", ".h", ".cpp", ".sh"}
FILES = {path for name in (*FOLDERS, "tests", "workflow") for path in (ROOT / name).rglob("*")}
SOURCES = sorted({*PAGES} | {path for path in FILES if path.suffix in TEXTS})
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def _text(page: Path) -> str:
    """A page without its blocks of code."""
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def _links(page: Path) -> list[tuple[Path, str]]:
    """The linked file and the heading in it, for each link within the repository."""
    found = []
    for target in LINK.findall(re.sub(r"`[^`\n]*`", "", _text(page))):
        path, _, heading = target.partition("#")
        if not re.match(r"\w+:", target):
            found.append(((page.parent / path).resolve() if path else page, heading))
    return found


def _anchors(page: Path) -> set[str]:
    """The headings of a page as GitHub writes them in links, and explicit anchors."""
    text = _text(page)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower() for heading in headings)
    slugs = {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}
    return slugs | set(re.findall(r'<a (?:id|name)="([^"]+)"', text))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_open(page):
    broken = [
        f"{path.name}#{heading}"
        for path, heading in _links(page)
        if not path.exists() or (heading and path.suffix == ".md" and heading not in _anchors(path))
    ]
    assert not broken


def test_anchors_that_sources_cite_exist():
    """Docstrings, comments and descriptions cite headings of docs/ by file and anchor; each of them opens."""
    cited = {
        (source.relative_to(ROOT).as_posix(), page, anchor)
        for source in SOURCES
        for page, anchor in re.findall(r"\b(docs/\w+\.md)#([\w-]+)", source.read_text(encoding="utf-8"))
    }
    assert len(cited) > 50
    lost = [one for one in cited if not (ROOT / one[1]).is_file() or one[2] not in _anchors(ROOT / one[1])]
    assert sorted(lost) == []


KEYS = {f"{section}.{key}" for section in section_options() for key in section_keys(section)}
NAMED = re.compile(rf"(?<![\w./`-])`?((?:{'|'.join(section_options())})\.[a-z_0-9]+)\b(?![(/\[.])")
SUFFIXES = (".zarr", ".json", ".png", ".webp", ".ply", ".html", ".tsv", ".txt", ".h", ".md")


def _sentences(path: Path) -> list[str]:
    """The lines of a text; of code its strings, without their expressions, and its comments."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text.splitlines()
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    told = [token.string for token in tokens if token.type in (tokenize.STRING, tokenize.COMMENT)]
    return [re.sub(r"{[^{}]*}", "", string) for string in told]


def test_every_key_that_a_text_names_exists():
    """No message, description or page sends people to a key that is gone. Alarms and fields of results look alike."""
    folders = [ROOT / name for name in ("src", "docs", "config")]
    suffixes = ("py", "md", "yaml")
    texts = [path for folder in folders for suffix in suffixes for path in folder.rglob(f"*.{suffix}")]
    lost = [
        (path.relative_to(ROOT).as_posix(), key)
        for path in [ROOT / "README.md", *texts]
        for sentence in _sentences(path)
        for key in NAMED.findall(sentence)
        if key not in {*KEYS, *TABLE} and not key.endswith(SUFFIXES)
    ]
    modules = {key for _, key in lost if (ROOT / f"src/egosplat/{key.replace('.', '/')}.py").is_file()}
    assert [] == [one for one in lost if one[1] not in modules]


def test_every_module_that_a_page_names_exists():
    modules = {path.name for path in SOURCES}
    named = re.compile(r"`(?:[\w./-]*/)?(\w+\.(?:py|smk|cpp|h))`")
    pages = [page for page in (ROOT / "docs").glob("*.md") if page.name != "adding_a_stage.md"]
    lost = [(page.name, name) for page in pages for name in named.findall(_text(page)) if name not in modules]
    assert lost == []


@pytest.mark.parametrize("index", ["docs/index.md", "benchmarks/README.md"])
def test_an_index_links_every_page_of_its_folder(index):
    top = (ROOT / index).parent
    linked = {path for path, _ in _links(ROOT / index)} | {ROOT / index, top / "README.md"}
    pages = {*top.glob("*.md"), *top.glob("*/README.md")}
    assert sorted(page.name for page in pages - linked) == []


def test_the_architecture_lists_the_stages_of_the_pipeline():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| [^|]* \| `(\w+)[./]", text, re.MULTILINE)
    of_others = {"tiles"}
    made = [name for name in STAGES if name in (*PIPELINE, *of_others)]
    assert [stage for stage, _ in rows] == made
    assert [artifact for _, artifact in rows] == ["recording", *made[1:]]


def test_the_readme_is_read_in_a_minute():
    """What it is, one command, a question, your data, results, limits: at most 800 words, besides the bars of a table."""
    text = re.sub(r"<!--.*?-->", "", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(re.findall(r"\S*\w\S*", text)) <= 800


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_conventions_have_every_array(name):
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    part = text.partition(f"### {name}.zarr\n")[2].partition("\n### ")[0]
    lines = re.findall(r"^- (`.*?`) (\(.*?\), .*?): ", part, re.MULTILINE)
    rows = [(array, kind) for arrays, kind in lines for array in re.findall(r"`([\w/]+)`", arrays)]
    if name == "tiles":  # of seven scales
        (_, first), last = rows[1], rows.pop(2)
        rows[1:2] = [(f"scale/{n}", first.replace("_0", f"_{n}")) for n in range(int(last[0][-1]) + 1)]
    assert rows == [
        (array, f"({', '.join(map(str, field.dims))}), {field.dtype}, {field.unit}".removesuffix(", -"))
        for array, field in SCHEMAS[name].fields.items()
    ]


def test_the_citation_names_this_version_and_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert citation["version"] == egosplat.__version__
    (paper,) = citation["references"]
    assert readme.count(paper["title"]) >= 1 and len(paper["authors"]) == 7


def test_ci_and_the_catalog_use_what_is_there():
    ci = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    commands = [step.get("run", "") for job in ci["jobs"].values() for step in job["steps"]]
    targets = {match[1] for command in commands for match in re.finditer(r"^make ([\w-]+)", command)}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert {"lint", "test"} < targets <= set(re.findall(r"^([\w-]+):", makefile, re.MULTILINE))
    catalog = yaml.safe_load((ROOT / ".snakemake-workflow-catalog.yml").read_text(encoding="utf-8"))
    assert catalog["usage"]["report"] and "software-stack-deployment" in catalog["usage"]
