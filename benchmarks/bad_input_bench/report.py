"""The page of what was tried."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bad_input_bench.verdicts import ACCEPTED, CLEAR, VERDICTS


@dataclass(frozen=True)
class Tried:
    """One try: what was broken, what became of it, what was said, and why it may be accepted."""

    family: str
    name: str
    verdict: str
    said: str
    fine: str


def page(results: Sequence[Tried], seed: int, most: int) -> str:
    """Markdown."""
    return (
        "# Bad input\n\n"
        f"Made by `python benchmarks/bad_input.py docs/bad_input.md --seed {seed} --most {most}`. Each of {len(results)} inputs was "
        "broken in a copy of a small finished scene and given to the command that meets it. **Clear**: it ended with an "
        "error of at most four lines that names the file or key, and left nothing behind. **Accepted**: it was taken, "
        "and may be: [see below](#accepted). **Unclear**: an error that is longer or names nothing. **Traceback**: a "
        "traceback, a crash or no end. **Harm**: something else was touched, a smuggled command ran, a connection was "
        "tried, an artifact was half made, or bad input was taken in silence.\n\n"
        f"{_table(results)}\n\n## Accepted\n\n{_accepted(results)}\n{_others(results)}"
    )


def _table(results: Sequence[Tried]) -> str:
    families = list(dict.fromkeys(one.family for one in results))
    lines = [f"| what is bad | tried | {' | '.join(VERDICTS)} |", "| --- |" + " ---: |" * (len(VERDICTS) + 1)]
    lines += [_row(name, [one for one in results if one.family == name]) for name in families]
    return "\n".join([*lines, _row("all", results)])


def _row(name: str, results: Sequence[Tried]) -> str:
    counts = [sum(one.verdict == verdict for one in results) for verdict in VERDICTS]
    return f"| {name} | {len(results)} | {' | '.join(map(str, counts))} |"


def _accepted(results: Iterable[Tried]) -> str:
    """Why, with how many and an example of each."""
    reasons: dict[str, list[str]] = {}
    for one in results:
        if one.verdict == ACCEPTED:
            reasons.setdefault(one.fine, []).append(f"{one.family}: {one.name}")
    return (
        "\n".join(f"- {len(names)} times: {why} (as {_plain(names[0])})." for why, names in reasons.items())
        or "None."
    )


def _others(results: Iterable[Tried]) -> str:
    """What is left to mend, each."""
    left = [one for one in results if one.verdict not in (CLEAR, ACCEPTED)]
    if not left:
        return ""
    lines = (f"- {one.verdict}: {one.family}: {_plain(one.name)}" for one in left)
    return "\n## To mend\n\n" + "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """On one line of code in Markdown."""
    return f"`{' '.join(text.encode('unicode_escape').decode().replace('`', ' ').split())}`"
