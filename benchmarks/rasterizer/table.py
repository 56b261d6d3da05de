"""The measurements as Markdown."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from benchmarks.rasterizer.comparison import PEERS, Rows, find_row, ratio
from benchmarks.rasterizer.iteration import PHASES
from benchmarks.rasterizer.roofline import flops_per_pair


def markdown(results: dict[str, Any], command: str) -> str:
    """The whole report.

    Args:
        results: see ``measure.everything``.
        command: what made it.
    """
    sections = (
        _head(results["machine"], command),
        _scenes(results["scenes"]),
        _processor_time(results["raster"]),
        _wall_time(results["raster"]),
        _roofline(results),
        _iterations(results["iterations"]),
        _channels(results["sweep"]),
        _frozen(results["frozen"], results["sweep"]),
        *(_memory(results["memory"], grows) for grows in ("Gaussians", "pixels", "channels")),
    )
    return "\n\n".join(sections) + "\n"


def _head(machine: dict[str, Any], command: str) -> str:
    return (
        f"# The rasterizer's speed\n\n`{command}` on {machine['date']}: {machine['cpu']}, {machine['cores']} cores, "
        f"{machine['memory_gib']} GiB; {machine['compiler']}; Python {machine['python']}, torch {machine['torch']}.\n\n"
        "CPU-ms are processor time of one thread, median / minimum of calls that take turns; ratios are of the "
        "minima. Times on two threads are the best on the clock. avx512, avx2 and generic are the variants of the "
        "C++ kernels, torch is `egosplat.rasterize.reference`, numba a port in Python; all in float32."
    )


def _scenes(scenes: dict[str, dict[str, int]]) -> str:
    rows = [
        (
            name,
            f"{scene['gaussians']:,}",
            f"{scene['width']}x{scene['height']}",
            f"{scene['visible']:,}",
            f"{scene['intersections']:,}",
            f"{scene['pairs'] / (scene['width'] * scene['height']):.1f}",
        )
        for name, scene in scenes.items()
    ]
    header = (
        "scene",
        "Gaussians",
        "size",
        "visible",
        "(tile, Gaussian) pairs",
        "composited Gaussians a pixel",
    )
    return "## Scenes\n\nA furnished room, seen by its first camera.\n\n" + _table(header, rows)


def _processor_time(rows: Rows) -> str:
    cases, names = _cases(rows), _names(rows)
    lines: list[Sequence[str]] = [
        (name, *(_both(find_row(rows, *case, name)) for case in cases)) for name in names
    ]
    lines += [
        (f"**{peer} / {name}**", *(f"{ratio(rows, *case, name, peer):.1f}x" for case in cases))
        for peer in PEERS
        for name in names
        if name not in PEERS
    ]
    return "## Forward and backward pass, one thread [CPU-ms]\n\n" + _table(_header(cases), lines)


def _wall_time(rows: Rows) -> str:
    cases, key = _cases(rows), "wall_ms_min_2_threads"
    names = [name for name in _names(rows) if key in find_row(rows, *cases[0], name)]
    lines: list[Sequence[str]] = [
        (name, *(f"{find_row(rows, *case, name)[key]:.1f}" for case in cases)) for name in names
    ]
    for name in names:
        if name not in PEERS:
            times = [find_row(rows, *case, "torch")["cpu_ms_min"] for case in cases]
            walls = [find_row(rows, *case, name)[key] for case in cases]
            ratios = (f"{time / wall:.1f}x" for time, wall in zip(times, walls, strict=True))
            lines.append((f"**torch on one thread / {name} on two**", *ratios))
    return "## Forward and backward pass, two threads [best ms on the clock]\n\n" + _table(
        _header(cases), lines
    )


def _roofline(results: dict[str, Any]) -> str:
    rows, scenes = results["raster"], results["scenes"]
    peak, names = max(results["peak_gflops"].values()), _names(rows)
    measured = ", ".join(f"{name} {value}" for name, value in results["peak_gflops"].items())
    lines = []
    for scene, channels in _cases(rows):
        gflop = 1e-9 * scenes[scene]["pairs"] * flops_per_pair(channels)
        floor = 1e3 * gflop / peak
        shares = [
            f"{100 * floor / find_row(rows, scene, channels, name)['cpu_ms_min']:.1f} %" for name in names
        ]
        pairs = f"{1e-6 * scenes[scene]['pairs']:.2f}"
        lines.append((scene, str(channels), pairs, f"{gflop:.2f}", f"{floor:.1f}", *shares))
    header = ("scene", "channels", "million pairs", "useful GFLOP", "floor [ms]", *names)
    return (
        f"## Share of the machine's peak\n\nMeasured multiply-adds of one core [GFLOP/s]: {measured}. Useful are "
        "26 + 2 C operations forward and 46 + 4 C backward for each composited (pixel, Gaussian) pair with C "
        "channels.\n\n" + _table(header, lines)
    )


def _iterations(rows: Rows) -> str:
    lines = [
        (
            row["scene"],
            row["variant"],
            *(f"{row['phases'][phase]:.1f}" for phase in PHASES),
            _both(row),
            f"{row['wall_ms_min_2_threads']:.1f}",
        )
        for row in rows
    ]
    header = ("scene", "variant", *PHASES, "all", "two threads [ms]")
    return (
        "## A training iteration, one thread [CPU-ms]\n\n`egosplat.gaussians.trainer.iterate`: SH of degree 3, L1 + SSIM, Adam; "
        "eight cameras in turn. Phases are medians.\n\n" + _table(header, lines)
    )


def _channels(rows: Rows) -> str:
    cases = _cases(rows)
    lines = [(name, *(_both(find_row(rows, *case, name)) for case in cases)) for name in _names(rows)]
    header = ("variant", *(str(channels) for _, channels in cases))
    return "## Channels, scene D, forward and backward pass, one thread [CPU-ms]\n\n" + _table(header, lines)


def _frozen(rows: Rows, sweep: Rows) -> str:
    lines = []
    for name in _names(rows):
        for scene, channels in _cases(rows):
            frozen, whole = (find_row(each, scene, channels, name) for each in (rows, sweep))
            times = f"{whole['cpu_ms_min'] / frozen['cpu_ms_min']:.2f}x"
            lines.append((name, str(channels), _both(frozen), _both(whole), times))
    header = ("variant", "channels", "channels alone", "all gradients", "ratio")
    return (
        "## Training of features on frozen geometry, scene D, one thread [CPU-ms]\n\n"
        "Forward and backward pass where the channels alone need a gradient.\n\n" + _table(header, lines)
    )


def _memory(rows: Rows, grows: str) -> str:
    rows = [row for row in rows if row["grows"] == grows]
    lines = [
        (
            f"{row['gaussians']:,}",
            f"{row['width']}x{row['height']}",
            str(row["channels"]),
            f"{row['mib']:.0f}",
        )
        for row in rows
    ]
    sizes = [_size(row, grows) for row in rows]
    slope, start, error = fit_line(sizes, [row["mib"] for row in rows])
    unit = {"Gaussians": "1,000 Gaussians", "pixels": "1,000 pixels", "channels": "channel"}[grows]
    return (
        f"## Peak memory of training against {grows}\n\nBeyond what the process takes before: {start:.0f} MiB + "
        f"{slope:.3g} MiB per {unit}, at most {100 * error:.0f} % off.\n\n"
        + _table(("Gaussians", "size", "channels", "peak [MiB]"), lines)
    )


def fit_line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float, float]:
    """Slope and start of the least-squares line, and its largest relative error."""
    slope, start = np.polyfit(x, y, 1)
    errors = np.abs(slope * np.asarray(x) + start - y) / y
    return float(slope), float(start), float(errors.max())


def _size(row: dict[str, Any], grows: str) -> float:
    sizes = {"Gaussians": row["gaussians"] / 1e3, "pixels": row["width"] * row["height"] / 1e3}
    return sizes.get(grows, row["channels"])


def _cases(rows: Rows) -> list[tuple[str, int]]:
    return list(dict.fromkeys((row["scene"], row["channels"]) for row in rows))


def _names(rows: Rows) -> list[str]:
    return list(dict.fromkeys(row["rasterizer"] for row in rows))


def _both(row: dict[str, Any]) -> str:
    return f"{row['cpu_ms_median']:.1f} / {row['cpu_ms_min']:.1f}"


def _header(cases: list[tuple[str, int]]) -> list[str]:
    return ["rasterizer", *(f"{scene}, {channels} ch." for scene, channels in cases)]


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] + ["---:"] * (len(header) - 1), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
