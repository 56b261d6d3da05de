"""Speed against accuracy of variants of one or more scenes: a page, a plot and the numbers."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from egosplat.errors import UserError
from egosplat.evaluation.scores import CHANCE
from egosplat.files import write_text
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.report.html_page import render_page
from egosplat_rivals.scored_scenes import ScoredScene
from egosplat_rivals.tables.page import TEMPLATE, Picture, Section, plain_table
from egosplat_rivals.tradeoff.chart import draw
from egosplat_rivals.tradeoff.measured import (
    COSTS,
    EVALUATION,
    GAINS,
    MEASURES,
    best_within,
    find_front,
    list_numbers,
    mean_points,
    read_runs,
)

# Minutes for which the page names the best point.
MINUTES = (1, 2, 3, 5, 10, 15, 30, 60, 120, 300, 720, 1440)

_BOUGHT = (
    "Of the points that take no longer on the clock of the machine that measured, one stage after the other: the most "
    "accurate, and the one with the largest PSNR. Minutes between two rows buy what the upper row says."
)
_TIMES = (
    "Time is the wall time of each stage; CPU time varies less if other processes ran at the same time. The PSNR of points "
    "with another frames.resolution is not comparable, because their photographs have another size. paper_scaled has the "
    "paper's settings except resolution, focal length, models and the thresholds of the models. With other models than the "
    "paper's, it says little about the paper."
)
_MACHINES = "These points were run on several machines: their times cannot be compared."
_ONCE = "Each point was run once, so the random variation is not known; intervals are for other categories."


def run(metrics: Sequence[Path], output: Path) -> None:
    """Write ``tradeoff.csv``, ``.png`` and ``.html`` below ``output`` atomically; equal inputs give equal bytes.

    ``metrics`` are ``metrics.json`` of scenes, each itself before its variants. UserError if one cannot be read or compared.
    """
    runs = read_runs(metrics)
    numbers = list_numbers(runs)
    if mean_points(numbers).empty:
        raise UserError("metrics: the scenes have no variant in common; give the same variants of each scene")
    csv, png, html = (output / f"tradeoff.{suffix}" for suffix in ("csv", "png", "html"))
    write_text(csv, numbers.to_csv(index=False))
    draw(numbers, png)
    write_text(html, write_page(runs, numbers, png))
    log(f"{len(runs)} points: {html}")


def write_page(runs: Sequence[ScoredScene], numbers: pd.DataFrame, picture: Path) -> str:
    """Write the page of one or more scenes, with their plot (UserError: the picture cannot be read)."""
    scenes, means = numbers.scene.unique(), mean_points(numbers)
    made = [record for run in runs for record in run.document["artifacts"].values()]
    # Some artifacts do not record a machine.
    machines = sorted({record["machine"] for record in made if "machine" in record})
    notices = {f"{run.dataset}/{run.scene}": run.document["notice"] for run in runs}
    several, style, names = len(scenes) > 1, f"named {runs[0].origin}", ", ".join(scenes)
    mean = f"Each number is the mean of {len(scenes)} scenes; points that a scene lacks are left out."
    caption = f"The Pareto front of each panel is a line{': thin for each scene, thick for their mean' if several else ''}."
    sections = [
        Section("plot", pictures=[Picture(picture, caption)]),
        Section(
            "bought", "What would I get for a number of minutes?", "", _bought_table(means), style, [_BOUGHT]
        ),
        Section("points", "Points", "", _points_table(numbers), style, list(_notes(runs[0], means))),
        *(
            Section(name, f"{COSTS[name].label} of each stage", "", _stages_table(numbers, name), style)
            for name in ("wall_s", "cpu_s")
        ),
    ]
    for scene in scenes if several else ():
        sections.append(Section(scene, scene, "", _points_table(numbers[numbers.scene == scene]), style))
    return render_page(
        *TEMPLATE,
        generator="egosplat-rivals tradeoff",
        title=f"Speed against accuracy: {names}, {numbers.about.iloc[0]}",
        heading=f"Speed against accuracy: {names}",
        intro=[f"Measured on {numbers.about.iloc[0]}, {'; '.join(machines)}.", mean if several else _ONCE],
        warnings=[
            *(f"Notice on {scene}: {notice}." for scene, notice in notices.items() if notice),
            *([_MACHINES] if len(machines) > 1 else []),
        ],
        sections=sections,
    )


def _notes(run: ScoredScene, points: pd.DataFrame) -> Iterator[str]:
    about = "; ".join(f"{one.heading}: {one.about}" for one in (COSTS | GAINS).values())
    yield (
        f"◆: on the Pareto front of time and accuracy. {about}. A stage that points share counts fully for each of them. "
        f"Evaluation ({', '.join(EVALUATION)}) does not count; its time is in the table below."
    )
    scores = run.document["scores"]["all"]
    told = (f"{name} {MEASURES['accuracy'].text(scores[key])} %" for key, name in CHANCE.items())
    yield f"Accuracy by chance in {run.dataset}/{run.scene}: {', '.join(told)}."
    yield _TIMES
    if others := list(points.index[points.queries != points.queries.iloc[0]]):
        yield f"Scores of other queries than the first point's, which cannot be compared: {', '.join(others)}."


def _points_table(numbers: pd.DataFrame) -> str:
    points = mean_points(numbers)
    front, about = find_front(points), numbers.drop_duplicates("point").set_index("point").about
    totals = numbers[numbers.stage == ""].set_index(["point", "measure"])
    several = numbers.scene.nunique() > 1

    def cell(label: str, name: str) -> str:
        text = MEASURES[name].text(points.loc[label, name])
        if several or (bounds := totals.loc[(label, name), ["low", "high"]].dropna()).empty:
            return text
        # The interval is on a second line.
        return f"{text}\n{'–'.join(map(MEASURES[name].text, bounds))}"

    return plain_table(
        [
            {"Point": f"{label} ◆" if label in front else label}
            | {one.label: cell(label, name) for name, one in MEASURES.items()}
            | {"Data, checkpoints": about[label]}
            for label in points.index
        ]
    )


def _bought_table(points: pd.DataFrame) -> str:
    """What each number of minutes buys; rows that say the same as the row above are left out."""
    rows, last = [], None
    for minutes in MINUTES:
        best = [best_within(points, gain, minutes) for gain in ("accuracy", "psnr")]
        if best == last:
            continue
        last = best
        row: dict[tuple[str, str], int | str] = {("", "Minutes"): minutes}
        for aim, label in zip(("finds most", "looks best"), best, strict=True):
            row[aim, "Point"] = label or "nothing"
            for name in ("wall_s", "cpu_s", *GAINS):
                row[aim, MEASURES[name].label] = MEASURES[name].text(
                    points.loc[label, name] if label else None
                )
        rows.append(row)
    return plain_table(rows)


def _stages_table(numbers: pd.DataFrame, time: str) -> str:
    measured, order = set(numbers.stage), sorted(STAGES, key=lambda stage: stage in EVALUATION)
    costs = {stage: mean_points(numbers, stage)[time] for stage in order if stage in measured}
    return plain_table(
        [
            {"Point": label} | {stage: COSTS[time].text(own.get(label)) for stage, own in costs.items()}
            for label in mean_points(numbers).index
        ]
    )
