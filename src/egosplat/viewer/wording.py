"""What the viewer says, as HTML. Words of users and names of folders are escaped."""

from collections.abc import Mapping, Sequence
from html import escape

from egosplat.geometry import Array
from egosplat.query.things import Thing
from egosplat.viewer.questions import Named, Questions, Reply
from egosplat.viewer.scene import ViewedScene

# Longest phrase that is repeated in an answer [letters].
_LONGEST = 80

WAITING = "Type what you look for, or choose a suggestion."
CLICK = "Click a surface to learn what it is."
OUTSIDE = "The answer is outside of the view: jump to it."


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f'<div style="padding:0.2em 0.7em;font-size:0.875em;overflow-wrap:anywhere">{text}</div>'


# The scale of ``pictures.heat``: the color map Turbo without its darkest ends.
LEGEND = paragraph(
    '<div style="display:flex;justify-content:space-between;padding:0 0.5em;border-radius:4px;color:#fff;'
    "text-shadow:0 0 3px #000;background:linear-gradient(90deg,#4454c4,#36aaf9 22%,#1ae4b6 40%,#72fe5e 50%,"
    '#c8ef34 61%,#faba39 75%,#f66b19 88%,#d23105)"><span>threshold</span><span>fit to the query</span>'
    "<span>best tenth</span></div>"
)


def plain(text: str) -> str:
    """A paragraph of a text that may hold anything."""
    return paragraph(escape(text))


def reply_text(reply: Reply, questions: Questions, unit: str) -> str:
    """The answer to a question."""
    phrase = f"<b>{escape(reply.answer.phrase[:_LONGEST])}</b>"
    if reply.refusal:
        # The score of a word that the model does not know means nothing.
        below = reply.answer.score < questions.options.min_score
        score = f" (score {reply.answer.score:.2f})" if below else ""
        return paragraph(f"{phrase}: {escape(reply.refusal)}{score}")
    rows = "".join(
        f"<li>score {thing.score:.2f}, {escape(questions.levels[thing.level])}<br>{_place(thing, unit)}"
        f"<br>best seen in frame {questions.best_frame(thing)}</li>"
        for thing in reply.things
    )
    return paragraph(f'{phrase}<ol style="margin:0;padding-left:1.4em">{rows}</ol>')


def named_text(named: Named, levels: Sequence[str], owners: Mapping[str, int], unit: str) -> str:
    """What is at a place that was clicked."""
    if named.position is None:
        return plain("There is nothing.")
    rows = []
    for level, words in zip(levels, named.words, strict=True):
        known = ", ".join(f"{escape(word)} {fit:.2f}" for word, fit in words) or "no known word fits"
        instance = f" (instance {owners[level]})" if level in owners else ""
        rows.append(f"<li>{escape(level)}{instance}: {known}</li>")
    listed = f'<ul style="margin:0;padding-left:1.4em">{"".join(rows)}</ul>'
    return paragraph(f"At {_numbers(named.position)} {unit}:{listed}")


def scene_text(viewed: ViewedScene, silence: str | None, notice: str | None) -> str:
    """What the scene is."""
    counts = (
        f"{viewed.trained.gaussians.count:,} Gaussians, {len(viewed.registered)} of "
        f"{len(viewed.camera_to_world)} frames with a pose, origin {escape(viewed.splats.origin)}, "
        f"lengths in {viewed.unit}"
    )
    told = (escape(line) for line in (silence, notice) if line)
    lines = [f"<b>{escape(str(viewed.folder))}</b>", counts, *told]
    return paragraph("<br>".join(lines))


def _place(thing: Thing, unit: str) -> str:
    size = " x ".join(f"{side:.2f}" for side in thing.high - thing.low)
    return f"center {_numbers(thing.center)} {unit}, size {size} {unit}"


def _numbers(point: Array) -> str:
    return ", ".join(f"{one:.2f}" for one in point)
