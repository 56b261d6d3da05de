"""The steps of a run, read from Snakemake's lines: one line for each, and the time that is left."""

import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from egosplat.doctor.examination import duration
from egosplat.pipeline.costs import UNREAD_FRAMES, Sizes, minutes
from egosplat.pipeline.dag import decide, decided_by_survey, stages_behind
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.snakemake_call import last_message
from egosplat.pipeline.stages import PIPELINE, STAGES
from egosplat.pipeline.survey_file import read_survey

# The page that a run makes, whose inputs are all that a query needs.
GOAL = "scene_page"

# Time of a step that draws a page, on an idle machine [s].
_PAGE_S = 10.0

# Steps of so much expected time have to end before their pace counts for more than the machine's load [s].
_TRUSTED_S = 20.0

# Of what Snakemake says without a message of egosplat, so many lines are repeated.
_MOST_LINES = 5

_PLANNED = re.compile(r"(\w+) +(\d+)")
_BEGUN = re.compile(r"(?:local)?(?:rule|checkpoint) (\w+):")
_ENDED = re.compile(r"Finished jobid: \d+ \(Rule: (\w+)\)")
_DONE = re.compile(r"(\d+) of (\d+) steps \(.*\) done")
_FAILED = re.compile(r"Error in rule (\w+):")
_LOG = re.compile(r" +log: (.+) \(check log file")
_ALARM = re.compile(r"\w+: (alarm|warning): ")
_NOTHING, _OWN = "Nothing to be done", "egosplat: "


def describe(step: str) -> str:
    """Say what a step does."""
    text = STAGES[step].help.rstrip(".") if step in STAGES else step
    return text[0].lower() + text[1:]


def machine_pace(cores: int) -> float:
    """Time of a run on ``cores`` of this machine as it is busy now, as a factor of the time on two idle cores."""
    load, every = os.getloadavg()[0], os.cpu_count() or 1
    return 2 / min(cores, 2) * max(1.0, (load + cores) / every)


@dataclass
class Forecast:
    """Expected times of a scene's steps on an idle machine: of a number of frames before a stride, with or without poses."""

    scene: Scene
    count: int | None
    known: bool

    def steps(self) -> list[str]:
        """List the stages of the run, as far as it is known what the survey decides."""
        config, survey = self.scene.config, self.scene.results / "survey.json"
        if decided_by_survey(config) and survey.exists():
            config = decide(config, read_survey(survey))
        return stages_behind([GOAL], config)

    def seconds(self, step: str) -> float:
        """Get the expected time of a step [s], from the sizes of what is there already."""
        if step not in PIPELINE:
            return _PAGE_S
        config = self.scene.config
        if not self.known:
            config = config | {"poses": config["poses"] | {"method": "colmap"}}
        frames = (self.count or UNREAD_FRAMES) / config["frames"]["stride"]
        made = [self.scene.results / f"{stage}.zarr" for stage in STAGES]
        sizes = Sizes(step, config, [str(path) for path in made if (path / "zarr.json").is_file()], frames)
        return 60 * minutes(step, config, sizes)


class Steps:
    """The steps of a run.

    Attributes:
        running: time at which each running step began.
        failed: log of each step that failed.
        work: the last line of a running step, or the names of those that run.
        said: what Snakemake and the workflow said that is about no step.
    """

    def __init__(self, forecast: Forecast, pace: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin, at the pace of ``machine_pace`` until steps have ended; ``clock`` gets the time [s]."""
        self._forecast, self._pace, self._clock = forecast, pace, clock
        self.running: dict[str, float] = {}
        self.failed: dict[str, Path] = {}
        self.said: list[str] = []
        self.work = ""
        self._left: set[str] = set()
        self._ended: list[str] = []
        self._surveyed, self._failing, self._cause = False, "", ""
        self._begun = self._last_end = clock()
        self._expected_s = 0.0

    def read(self, line: str) -> list[str]:
        """Take one line of Snakemake or of a step; get the lines for the user, mostly none."""
        if line.partition(": ")[0] in self.running:
            self.work = line
        if found := _BEGUN.fullmatch(line):
            self.running[found[1]] = self._clock()
            self.work = f"{', '.join(self.running)} ..."
        elif found := _ENDED.fullmatch(line):
            self._ended.append(found[1])
        elif found := _DONE.fullmatch(line):
            return [self._end(found[1], found[2])]
        elif found := _FAILED.fullmatch(line):
            self._failing = found[1]
        elif self._failing and (found := _LOG.match(line)):
            self.failed.setdefault(self._failing, Path(found[1]))
        elif (found := _PLANNED.fullmatch(line)) and not (self.running or self._ended):
            return self._plan(found[1], int(found[2]))
        elif line.startswith(_NOTHING):
            return ["every step is up to date"]
        elif self.running and _ALARM.match(line):
            return [line]
        elif self.running and line.startswith(_OWN):
            self._cause = line.removeprefix(_OWN)
        elif not self.running and not self._failing:
            self.said.append(line)
            return [line.removeprefix(_OWN)] if line.startswith(_OWN) else []
        return []

    def remaining_s(self) -> float:
        """Get the expected time until the end [s]."""
        pace = (_TRUSTED_S * self._pace + self._last_end - self._begun) / (_TRUSTED_S + self._expected_s)
        left = self._left | (set(self._forecast.steps()) if self._surveyed else set())
        times = {step: pace * self._forecast.seconds(step) for step in left.difference(self._ended)}
        for step in times.keys() & self.running.keys():
            # A step that takes longer than expected takes some more.
            times[step] = max(times[step] - self._clock() + self.running[step], 0.1 * times[step])
        return sum(times.values())

    def _plan(self, step: str, count: int) -> list[str]:
        if step != "total":
            self._left.add(step)
            return []
        self._surveyed = "survey" in self._left
        more = ", or more: the survey decides" if self._surveyed else ""
        if self._forecast.count is None:
            return [f"{count} steps{more}; how long they take is said when the frames are counted"]
        return [
            f"{count} steps{more}; about {duration(self.remaining_s())} on processors as busy as these are"
        ]

    def _end(self, done: str, total: str) -> str:
        step, now = self._ended[-1], self._clock()
        took = now - self.running.pop(step, now)
        self.work = f"{', '.join(self.running)} ..." if self.running else ""
        self._last_end, self._expected_s = now, self._expected_s + self._forecast.seconds(step)
        left = f"; about {duration(self.remaining_s())} left" if done != total else ""
        return f"{done:>2}/{total} {step}: {describe(step)}, {duration(took)}{left}"

    def explain(self) -> str:
        """Say why the run failed, in a line or two for each step."""
        told = []
        for step, log in self.failed.items():
            message = last_message(log)
            # One that was killed left no message: the shell around it says so.
            message = self._cause if self._cause and message.startswith("See ") else message
            told.append(f"{step}: {message}\nThe whole log: {log}")
        own = [number for number, line in enumerate(self.said) if line.startswith(_OWN)]
        last = self.said[own[-1] :] if own else [line for line in self.said if line.strip()][-_MOST_LINES:]
        return "\n".join(told or [line.removeprefix(_OWN) for line in last])
