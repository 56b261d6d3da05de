"""The measurements as a page in Markdown."""

from typing import Any

from benchmarks.common import markdown
from benchmarks.rasterizer.comparison import Rows, find_row, ratio


def page(results: dict[str, Any]) -> str:
    """The whole page of ``comparison.everything``."""
    machine = results["machine"]
    head = (
        f"# Speed of the rasterizer\n\n`python -m benchmarks.rasterizer` on {machine['date']}: {machine['cpu']}; {machine['compiler']}; "
        f"Python {machine['python']}, torch {machine['torch']}.\n\n"
        "CPU-ms are processor time of one thread, median / minimum of calls that take turns; ratios are of the minima. avx512, avx2 and generic are variants of the C++ kernels; torch is "
        "`egosplat.rasterize.reference`. All compute in float32."
    )
    parts = [
        head,
        f"## Forward and backward pass, one thread [CPU-ms]\n\n{_passes(results['raster'])}",
        "## A training iteration, one thread [CPU-ms]\n\nSH of degree 3, L1 + SSIM, Adam; eight cameras in turn.\n\n"
        + _iterations(results["iterations"]),
    ]
    return "\n\n".join(parts) + "\n"


def _passes(rows: Rows) -> str:
    cases, names = _cases(rows), _names(rows)
    lines = [[name, *(_both(find_row(rows, *case, name)) for case in cases)] for name in names]
    lines += [
        [f"**torch / {name}**", *(f"{ratio(rows, *case, name):.1f}x" for case in cases)]
        for name in names
        if name != "torch"
    ]
    return markdown(["rasterizer", *(f"{scene}, {count} ch." for scene, count in cases)], lines)


def _iterations(rows: Rows) -> str:
    lines = [[row["scene"], row["variant"], _both(row)] for row in rows]
    return markdown(["scene", "variant", "one thread"], lines, words=2)


def _cases(rows: Rows) -> list[tuple[str, int]]:
    return list(dict.fromkeys((row["scene"], row["channels"]) for row in rows))


def _names(rows: Rows) -> list[str]:
    return list(dict.fromkeys(row["rasterizer"] for row in rows))


def _both(row: dict[str, Any]) -> str:
    return f"{row['cpu_ms_median']:.1f} / {row['cpu_ms_min']:.1f}"
