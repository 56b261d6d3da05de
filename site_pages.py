"""The site is the repository: its pages, the sources that they link, and the library's reference (hooks of mkdocs.yml)."""

import posixpath
import re
import subprocess
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from describing import COMMENT

ROOT = Path(__file__).resolve().parent
PICTURES = (".png", ".webp")

# The demo's page of its scene, which the site has where make demo ran.
SCENE = ROOT / "results/adt/scene1/scene.html"

_FENCE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")
_EXPORTED = re.compile(r"^from (\S+) import (\w+) as", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Take the repository's pages and pictures under their own paths, in place of the folder docs/ alone."""
    for file in [file for file in files if file.src_dir == config.docs_dir]:
        files.remove(file)
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = {name for name in tracked.splitlines() if not name.startswith(".github/")}
    pages = {name for name in names if name.endswith(".md")}
    for name in sorted(pages | {name for name in names if name.endswith(PICTURES)}):
        files.append(File(name, str(ROOT), config.site_dir, config.use_directory_urls))
    for name in sorted({source for page in pages for source in _sources(page)}):
        fence = f"```{Path(name).suffix.removeprefix('.').replace('tsv', '')}"
        text = f"---\nsearch: {{exclude: true}}\n---\n# {name}\n\n{fence}\n{(ROOT / name).read_text()}\n```\n"
        files.append(File.generated(config, f"{name}.md", content=text))
    files.append(File.generated(config, "reference.md", content=_reference()))
    if SCENE.is_file():
        files.append(File(SCENE.name, str(SCENE.parent), config.site_dir, config.use_directory_urls))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Leave out the marks of quoted figures, and link a source by its page."""
    path = page.file.src_uri
    if not (ROOT / path).is_file():
        return markdown
    parts = _FENCE.split(re.sub(rf"^(?:{COMMENT.pattern})\n", "", markdown, flags=re.MULTILINE | re.DOTALL))
    for at in range(0, len(parts), 2):
        parts[at] = _LINK.sub(lambda link: _opened(link, path), COMMENT.sub("", parts[at]))
    if path == "README.md" and SCENE.is_file():
        parts.insert(0, f"[Ask a room, here in the browser]({SCENE.name}){{ .md-button }}\n\n")
    return "".join(parts)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Link the pages that docstrings name."""
    if page.file.src_uri != "reference.md":
        return html
    return re.sub(r"docs/(\w+)\.md(#[\w-]+)?", r'<a href="../docs/\1/\2">\g<0></a>', html)


def _reference() -> str:
    """The page of what ``import egosplat`` offers, by its stub; options come last."""
    exported = _EXPORTED.findall((ROOT / "src/egosplat/__init__.pyi").read_text())
    exported.sort(key=lambda one: one[1].endswith("Options"))
    told = "[In Python](docs/python.md) shows them at work."
    parts = (f"::: {module}.{name}\n    options: {{heading: egosplat.{name}}}" for module, name in exported)
    return "\n\n".join(["# Reference", told, *parts])


def _sources(page: str) -> set[str]:
    """The files, no pages nor pictures, that a page links."""
    text = _FENCE.sub("", (ROOT / page).read_text())
    found = (_target(page, link[1]) for link in _LINK.finditer(text))
    return {name for name in found if name and not name.endswith((".md", *PICTURES))}


def _target(page: str, link: str) -> str | None:
    """The path in the repository of a link of a page; None for an address."""
    return None if ":" in link else posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def _opened(link: re.Match[str], page: str) -> str:
    name = _target(page, link[1])
    return f"]({link[1]}.md)" if name and not name.endswith((".md", *PICTURES)) else link[0]
