"""Results of a run without a target, and the check that a rule makes each target."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.dag import decide, default_pages
from egosplat.pipeline.scenes import Scene, requested_targets
from egosplat.pipeline.survey_file import Survey

# A target for messages.
EXAMPLE = "results/adt/scene1/metrics.json"


def default_scenes(scenes: Iterable[Scene]) -> list[Scene]:
    """Get the scenes of a run without a target: those with a recording, and synthetic ones that need not be named."""
    return [scene for scene in scenes if not (scene.by_name or scene.lacks_recording)]


def default_results(scene: Scene) -> list[str]:
    """Get the paths that such a run makes for a scene, except those that its survey decides."""
    return [str(scene.results / name) for name in default_pages(scene.config)]


def results_by_survey(scene: Scene, survey: Survey) -> list[str]:
    """Get the paths that such a run makes for a scene because of what its survey decides."""
    paths = [str(scene.results / name) for name in default_pages(decide(scene.config, survey))]
    return [path for path in paths if path not in default_results(scene)]


@dataclass(frozen=True)
class Rules:
    """What the rules make."""

    plain: frozenset[str]  # names of the rules without wildcards, which are targets, and their files
    of_scenes: frozenset[str]  # names of the rules with wildcards, which are none
    outputs: frozenset[str]  # names of files in the folder of a scene or variant
    is_made: Callable[[str], bool]  # whether a rule makes a file


def check_words(words: Iterable[str], scenes: Mapping[tuple[str, str], Scene], rules: Rules) -> None:
    """Check that rules make the targets of a command line (UserError: none makes one; names what is meant)."""
    for word in words:
        if word in rules.plain or rules.is_made(word.removeprefix("./")):
            continue
        if word.startswith("-"):
            raise UserError(f"{word}: is an option; write it before --, behind which every word is a target")
        if word in rules.of_scenes:
            raise UserError(f"{word}: is a rule for every scene; give a file, such as {EXAMPLE}")
        meant = _meant(word, scenes, rules)
        advice = f"did you mean {meant}?" if meant else f"targets are files such as {EXAMPLE}"
        raise UserError(f"no rule makes {word}; {advice}")


def _meant(word: str, scenes: Mapping[tuple[str, str], Scene], rules: Rules) -> str | None:
    """The file that a word means: by its place, as the folder or name of a scene, or by its letters."""
    here = Path(word).absolute()
    if here.is_relative_to(Path.cwd()) and rules.is_made(inside := str(here.relative_to(Path.cwd()))):
        return inside
    folder = "/" + word.lower().strip("/")
    for scene in scenes.values():
        if f"/{scene.results}".lower().endswith(folder):
            return f"{scene.results}/metrics.json"
    homes = [f"{scene.results}/" for scene in scenes.values()]
    if found := requested_targets([word]):
        homes = [word.removesuffix(found[0].name)]
    known = [*rules.plain, *(home + name for home in homes for name in sorted(rules.outputs))]
    lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(word.lower(), lower, n=1)
    return lower[near[0]] if near else None
