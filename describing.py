"""README and addresses as the page of the package on PyPI shows them (setup.py)."""

import re
from pathlib import Path

COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def repository(root: Path) -> str:
    """The address of the repository in CITATION.cff, the one place that has it; empty while it has none."""
    found = re.search(r'^repository-code: "?([^\s"]+)', (root / "CITATION.cff").read_text(), re.MULTILINE)
    return found[1].rstrip("/") if found else ""


def page(readme: str, address: str, version: str) -> str:
    """README in which links and pictures of the repository are those of a version at ``address``; without an address, a
    link becomes its text, and a picture goes."""

    def opened(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        if re.match(r"\w+:", target):
            return match[0]
        if not address:
            return "" if picture else text
        file = target if not target.startswith("#") else f"README.md{target}"
        return f"{picture}[{text}]({address}/{'raw' if picture else 'blob'}/v{version}/{file})"

    return _LINK.sub(opened, COMMENT.sub("", readme))


def addresses(address: str) -> dict[str, str]:
    """The addresses beside the package's page; none without one of the repository."""
    pages = {"Repository": "", "Changelog": "/blob/main/CHANGELOG.md", "Issues": "/issues"}
    return {name: address + path for name, path in pages.items() if address}
