"""Scores, their intervals and paired differences, computed from rows."""

import inspect
from collections.abc import Callable, Mapping, Sequence

import pandas as pd

from benchmarks.common import markdown
from benchmarks.intervals.differences import paired_difference
from benchmarks.presence.__main__ import fitted
from benchmarks.rows import Rows
from egosplat.errors import UserError
from egosplat.evaluation.intervals import Clusters, cluster, clustered_interval, mean_of_scenes
from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.scored_scenes import FULL, PIXELS

# How intervals and p values are computed, for the first lines of a page.
METHOD = (
    "Scores have 95 % intervals of a bootstrap over categories and scenes. Differences have p, and the 95 % interval that agrees with "
    "it, from sign flips of each scene's categories; for other scenes, a t interval of the scenes' means where it is wider."
)

# Column of the queries that each score averages, its scale, and how it is written.
SCORES = {"accuracy": ("hit", 100, ".0f", " %"), "mean_iou": ("iou", 1, ".2f", "")}

# Highest PSNR that an interval may reach [dB].
_MOST_DB = 100.0

KEYS = ["scene", "frame", "category"]


def by_scene(rows: pd.DataFrame, column: str, group_by: str = "category") -> list[Clusters]:
    """The values of a column by scene, clustered by another column; rows without a value are left out."""
    known = rows.dropna(subset=[column])
    return [
        cluster(own[column].astype(float).tolist(), own[group_by].astype(str).tolist())
        for _, own in known.groupby("scene", sort=True)
    ]


def figure(scenes: list[Clusters], scale: float, form: str, unit: str, most: float = 1.0) -> str:
    """The mean over scenes with its interval, such as ``77 % (68 to 85)``; - for nothing."""
    if not scenes:
        return "-"
    interval = clustered_interval(scenes, most=most)
    bounds = "" if interval is None else f" ({scale * interval[0]:{form}} to {scale * interval[1]:{form}})"
    return f"{scale * mean_of_scenes(scenes):{form}}{unit}{bounds}"


def score(rows: Rows, setting: str, name: str, group: str = "all") -> str:
    """Accuracy or mIoU of a setting."""
    column, *how = SCORES[name]
    return figure(by_scene(rows.of("queries", setting, group=group), column), *how)


def difference(rows: Rows, one: str, other: str, name: str, group: str = "all") -> str:
    """Mean difference of two settings on the same queries, see ``format_difference``."""
    return format_difference(by_scene(pair(rows, one, other, SCORES[name][0], group), "difference"))


def format_difference(scenes: Sequence[Clusters]) -> str:
    """A ``paired_difference`` in points, such as ``+3.1 (-2.0 to +8.2), p = 0.24``; - for nothing."""
    if not scenes:
        return "-"
    mean, interval, p, over_scenes = paired_difference(scenes)
    # Three digits where two would put p on the other side of the interval's limit.
    told = f"{p:.2g}" if (p < 0.05) == (float(f"{p:.2g}") < 0.05) else f"{p:.3g}"
    beside = f"; t over apartments: {_bounds(over_scenes)}" if over_scenes else ""
    return f"{_points(mean)} ({_bounds(interval)}), {'p < 0.001' if p < 0.001 else f'p = {told}'}{beside}"


def _bounds(interval: tuple[float, float]) -> str:
    return f"{_points(interval[0])} to {_points(interval[1])}"


def _points(difference: float) -> str:
    """Only zero itself has no sign."""
    return f"{100 * difference:+.1f}" if difference else "0.0"


def pair(rows: Rows, one: str, other: str, column: str, group: str = "all") -> pd.DataFrame:
    """The queries that two settings share, with the ``difference`` of a column."""
    return _paired(rows, "queries", KEYS, (one, other), column, group)


def pair_frames(rows: Rows, one: str, other: str, group: str = "all") -> pd.DataFrame:
    """The held-out frames that two settings share, with the ``difference`` of their PSNR."""
    return _paired(rows, "frames", KEYS[:2], (one, other), "psnr", group)


def _paired(
    rows: Rows, table: str, keys: list[str], settings: tuple[str, str], column: str, group: str
) -> pd.DataFrame:
    mine, theirs = (rows.of(table, name, group=group) for name in settings)
    paired = mine.merge(theirs, on=keys, suffixes=("", "_other"))
    return paired.assign(difference=paired[column] - paired[f"{column}_other"])


def psnr(rows: Rows, setting: str, group: str = "all") -> str:
    """PSNR of held-out frames over all, static or dynamic pixels."""
    frames = by_scene(rows.of("frames", setting, group=group), "psnr", group_by="frame")
    return figure(frames, 1, ".1f", " dB", most=_MOST_DB)


def presence(rows: Rows, setting: str, what: str) -> str:
    """Share of whole-scene queries: present things found, rightly (``right``), right best guesses; ``absent`` ones found, of
    those that the text model knows, their number ``asked``, and that of those ``refused`` without asking."""
    absent = what in ("absent", "asked", "refused")
    asked = rows.of("presence", setting, present=int(not absent))
    if absent:
        asked = asked[asked["untaught"] == int(what == "refused")]
    if what in ("asked", "refused"):
        return str(len(asked))
    graded = asked["grade"] == "best guess" if what == "guessed" else asked["answered"]
    # An answer that no frame could verify is not right.
    right = asked["right"].astype(float).fillna(0) if what in ("right", "guessed") else 1.0
    return figure(by_scene(asked.assign(value=graded * right), "value", group_by="phrase"), 100, ".0f", " %")


def chance(rows: Rows, setting: str, answerer: str) -> str:
    """Accuracy of a blind answer on a setting's queries."""
    column = answerer.replace("_pixel", "_hit")
    return f"{100 * mean_of_scenes(by_scene(rows.of('queries', setting, group='all'), column)):.0f} %"


def minutes(rows: Rows, setting: str) -> str:
    """CPU-minutes a scene."""
    return f"{rows.of('runs', setting)['cpu_s'].mean() / 60:.1f}"


def places(rows: Rows, what: str) -> str:
    """Number of places of carried things: ``all``, or those that are told, rightly (``right``) or not (``wrong``).

    Raises:
        UserError: there is no such number.
    """
    right, told = rows.tables["places"]["right"], rows.tables["places"]["told"]
    counts = {"all": len(told), "right": right.sum(), "wrong": (told - right).sum()}
    if what not in counts:
        raise UserError(f"{rows.about['name']}: has no places {what!r}; has {', '.join(counts)}")
    return str(int(counts[what]))


def queries(rows: Rows, setting: str) -> str:
    """Number of queries."""
    return str(len(rows.of("queries", setting, group="all")))


def score_table(rows: Rows, world: str | None = None) -> str:
    """A row for each setting, over the scenes of a world or all."""
    rows = rows.within(world)
    columns = (
        "setting",
        "queries",
        "found",
        "static",
        "movable",
        "mIoU",
        "PSNR",
        "PSNR, static",
        "present: right",
    )
    table = [
        [
            name,
            queries(rows, name),
            *(score(rows, name, "accuracy", group) for group in ("all", "static", "dynamic")),
            score(rows, name, "mean_iou"),
            *(psnr(rows, name, group) for group in ("all", "static")),
            presence(rows, name, "right"),
            "{} of {}; {}".format(*(presence(rows, name, what) for what in ("absent", "asked", "refused"))),
            minutes(rows, name),
        ]
        for name in rows.settings
    ]
    return markdown((*columns, "absent: answered; refused", "CPU-min"), table)


def difference_table(rows: Rows, world: str | None = None) -> str:
    """A row for the default against each other setting, or for it asked by pixels, over the scenes of a world or all."""
    rows = rows.within(world)
    asked = [name for name in rows.settings if name in (PIXELS, f"{FULL}_{PIXELS}")]
    table = [
        [f"{own} against {name}", *(difference(rows, own, name, score) for score in SCORES)]
        for name in rows.settings
        for own in (asked if name.endswith(f"_{PIXELS}") and name not in asked else [FULL])
        if name != FULL
    ]
    return markdown(("compared", "accuracy", "mIoU"), table)


def chance_line(rows: Rows, world: str | None = None) -> str:
    """A sentence on blind answers, over the scenes of a world or all."""
    parts = (f"{name} {chance(rows.within(world), rows.settings[0], key)}" for key, name in CHANCE.items())
    return f"Found by chance: {', '.join(parts)}."


TABLES: Mapping[str, Callable[..., str]] = {
    "scores": score_table,
    "differences": difference_table,
    "blind": chance_line,
}

FIGURES: Mapping[str, Callable[..., str]] = {
    "accuracy": lambda rows, setting, *group: score(rows, setting, "accuracy", *group),
    "mean_iou": lambda rows, setting, *group: score(rows, setting, "mean_iou", *group),
    "accuracy_difference": lambda rows, one, other, *group: difference(rows, one, other, "accuracy", *group),
    "mean_iou_difference": lambda rows, one, other, *group: difference(rows, one, other, "mean_iou", *group),
    "psnr": psnr,
    "presence": presence,
    "chance": chance,
    "minutes": minutes,
    "places": places,
    "queries": queries,
    "fit": fitted,
}


def compute(rows: Rows, words: list[str]) -> str:
    """A table or figure by its words, such as ``accuracy occam`` or ``scores``.

    Raises:
        UserError: there is no such figure or setting, or words are missing.
    """
    known = {**TABLES, **FIGURES}
    name, *rest = words
    try:
        call = inspect.signature(known[name]).bind(rows, *rest)
    except (KeyError, TypeError):
        raise UserError(
            f"{' '.join(words)}: is no figure of rows; give {', '.join(known)}, then its settings"
        ) from None
    return known[name](*call.args)
