"""What the measurements say of each knob, in sentences made from the numbers alone."""

from collections.abc import Mapping, Sequence

from egosplat.tradeoff.estimates import Chance, Estimate, difference, ratio
from egosplat.tradeoff.measured import MeasuredPoint
from egosplat.tradeoff.measures import COSTS, GAINS, PSNR, WALL, Measure
from egosplat.tradeoff.points import PRESET, shown

_PHOTOGRAPH = ("resolution", "focal", "upright")
"""Keys of the section ``frames`` by which the photographs differ that renders are compared with."""

_NO_DIFFERENCE = "no difference seen in"

_SAME_COST = 0.005
"""A ratio of costs so near to 1 is none that anyone chooses by, however surely it is known."""


def knob_sentences(
    points: Sequence[MeasuredPoint], knob: str, chance: Mapping[Measure, Chance], confidence: float
) -> list[str]:
    """One sentence for each value of a knob that is not the scene's: what it buys and what it costs.

    Args:
        points: all, the scene itself first.
        knob: a key as ``features.dims``.
        chance: of all points, as ``chances`` finds it.
        confidence: of the intervals.
    """
    scene, own = points[0], points[0].setting(knob)
    others = [(point, point.setting(knob)) for point in points[1:] if point.setting(knob)]
    sentences = [
        f"{shown(other.value)} instead of {shown(own.value)} {trade(point, scene, chance, confidence)}."
        for point, other in sorted(others, key=lambda pair: _order(pair[1].value))
    ]
    alike = [one.value for one in scene.settings if one.knob == knob and one.value != own.value]
    return sentences + [f"{shown(value)} changes nothing of this scene." for value in alike]


def presets_sentence(
    points: Sequence[MeasuredPoint], chance: Mapping[Measure, Chance], confidence: float
) -> str | None:
    """How many times faster ``balanced`` is than the paper's settings, and at what loss; None without both."""
    by_name = {one.value: point for point in points for one in point.settings if one.knob == PRESET}
    if not {"balanced", "paper_scaled"} <= set(by_name):
        return None
    fast, paper = by_name["balanced"], by_name["paper_scaled"]
    faster = ratio(paper.sample(WALL), fast.sample(WALL), chance[WALL], confidence)
    bounds = "" if faster.low is None else f" ({faster.low:.3g} to {faster.high:.3g})"
    return (
        f"balanced takes {fast.sample(WALL).mean / 60:.1f} minutes, paper_scaled {paper.sample(WALL).mean / 60:.1f}: "
        f"it is {faster.value:.3g} times as fast{bounds}. In its place it {trade(fast, paper, chance, confidence)}."
    )


def trade(
    point: MeasuredPoint, other: MeasuredPoint, chance: Mapping[Measure, Chance], confidence: float
) -> str:
    """What a point buys and costs against another, ``buys ... and costs ...; no difference seen in ...``."""
    found = changes(point, other, chance, confidence)
    if any(estimate.low is None for _, estimate in found):
        told = ", ".join(measure.change(estimate) for measure, estimate in found)
        return f"was measured too few times to tell what is chance: {told}"
    seen = [(measure, one) for measure, one in found if _is_seen(measure, one)]
    bought = [measure.change(one) for measure, one in seen if _is_better(measure, one)]
    paid = [measure.change(one) for measure, one in seen if not _is_better(measure, one)]
    same = [measure.heading for measure, one in found if not _is_seen(measure, one)]
    nothing = f"; {_NO_DIFFERENCE} {_listed(same)}" if same else ""
    if not seen:
        return f"makes no difference that was seen, in {_listed(same)}"
    return f"buys {_listed(bought)} and costs {_listed(paid)}{nothing}"


def changes(
    point: MeasuredPoint, other: MeasuredPoint, chance: Mapping[Measure, Chance], confidence: float
) -> list[tuple[Measure, Estimate]]:
    """Ratios of costs and differences of gains, a point against another, of what was measured of both.

    PSNR is left out where the photographs are others, and with them what it is measured against.
    """
    found = []
    for measure in (*COSTS, *GAINS):
        left, right = point.sample(measure), other.sample(measure)
        if left is None or right is None or (measure is PSNR and _photographs(point) != _photographs(other)):
            continue
        compare = difference if measure in GAINS else ratio
        found.append((measure, compare(left, right, chance[measure], confidence)))
    return found


def _unchanged(measure: Measure) -> float:
    return 0.0 if measure.more_is_better else 1.0


def _is_seen(measure: Measure, found: Estimate) -> bool:
    if not measure.more_is_better and abs(found.value - 1) < _SAME_COST:
        return False
    return found.excludes(_unchanged(measure))


def _is_better(measure: Measure, found: Estimate) -> bool:
    return (found.value > _unchanged(measure)) == measure.more_is_better


def _photographs(point: MeasuredPoint) -> list[object]:
    options = point.runs[0].scored.document["artifacts"]["frames.zarr"]["options"]
    return [options.get(key) for key in _PHOTOGRAPH]


def _listed(parts: Sequence[str]) -> str:
    """Words in a row; ``nothing`` of none."""
    if len(parts) < 2:
        return "".join(parts) or "nothing"
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def _order(value: object) -> tuple[bool, float]:
    """Numbers by their size, then all else as it comes."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return not is_number, value if is_number else 0.0
