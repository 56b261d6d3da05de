"""README on the page of the package: what is linked there opens, or is not linked."""

import re

from describing import page
from tests.support import ROOT


def test_links_are_those_of_the_version_in_the_repository_or_their_text():
    readme, address = (ROOT / "README.md").read_text(encoding="utf-8"), "https://git.invalid/egosplat"
    shown, alone = page(readme, address, "1.2"), page(readme, "", "1.2")
    own = re.findall(rf"\]\({address}/(?:blob|raw)/v1\.2/([^)#]*)", shown)
    assert "docs/query.png" in own and all((ROOT / path).is_file() for path in own) and "<!--" not in shown
    targets = [re.findall(r"\]\(([^)]*)\)", text) for text in (shown, alone)]
    assert len(own) + len(targets[1]) == len(targets[0]) == readme.count("](")
    assert all(target.startswith("https://") for both in targets for target in both) and "![" not in alone
