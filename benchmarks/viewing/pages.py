"""Times of the scene page: made by the command, opened and asked in a browser."""

import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common import MIB, markdown
from benchmarks.viewing.browser import open_tab

HEADER = [
    "Gaussians of the scene",
    "on the page",
    "file [MiB]",
    "made in [s]",
    "first picture [s]",
    "first answer: heat, whole [s]",
    "next answers: heat, whole [s]",
    "click [s]",
]

# Asks, and returns how long the heat and the whole answer took [ms].
_ASK = "async (words) => { await egosplat.ask(words); return [egosplat.heatTime, egosplat.answerTime]; }"
_CLICK = (
    "() => { const begun = performance.now(); egosplat.explain(400, 250); return performance.now() - begun; }"
)


def table(rows: Sequence[Sequence[object]]) -> str:
    """The rows of ``measured``, in Markdown."""
    return markdown(HEADER, rows, words=0)


def measured(scene: Path, output: Path, most: int, words: Sequence[str]) -> list[str]:
    """Make the page of a scene with at most ``most`` Gaussians, open it, ask it; returns a row of the table."""
    command = [sys.executable, "-m", "egosplat.cli", "page", str(scene), "--output", str(output)]
    begun = time.perf_counter()
    subprocess.run([*command, "--set", f"max_gaussians={most}"], check=True, stdout=sys.stderr)
    made = time.perf_counter() - begun
    with open_tab() as page:
        page.goto(output.resolve().as_uri())
        page.wait_for_function("window.egosplat?.firstPicture")
        picture = page.evaluate("egosplat.firstPicture")
        counts = page.evaluate("[egosplat.scene.facts.trained_count, egosplat.scene.facts.count]")
        first, *others = (page.evaluate(_ASK, word) for word in words)
        heat, whole = (statistics.median(times) for times in zip(*others, strict=True))
        clicked = page.evaluate(_CLICK)
    return [
        *(f"{count:,}" for count in counts),
        f"{output.stat().st_size / MIB:.1f}",
        f"{made:.0f}",
        f"{picture / 1e3:.1f}",
        f"{first[0] / 1e3:.3f}, {first[1] / 1e3:.2f}",
        f"{heat / 1e3:.3f}, {whole / 1e3:.2f}",
        f"{clicked / 1e3:.2f}",
    ]
