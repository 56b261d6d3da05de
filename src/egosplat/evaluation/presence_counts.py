"""How often the whole scene answers a query, over several scenes, as ``metrics.json`` files tell it."""

from collections.abc import Iterable
from dataclasses import dataclass

from egosplat.tables.scored_scenes import ScoredScene


@dataclass(frozen=True)
class PresenceCounts:
    """Counts of queries.

    Attributes:
        present, absent: queries of things that are there, and of things that are not.
        answered, answered_absent: how many of each were answered.
        right: answered queries whose thing mostly belongs to the category.
    """

    present: int
    answered: int
    right: int
    absent: int
    answered_absent: int

    @property
    def told(self) -> str:
        """The counts in a sentence, without a full stop."""
        return (
            f"asked of the whole scene, {self.answered} of {self.present} things that are there are answered, "
            f"{self.right} of them rightly, and {self.answered_absent} of {self.absent} that are not there"
        )


def presence_counts(scenes: Iterable[ScoredScene]) -> PresenceCounts:
    """Sum the counts of scenes; those of other methods have none."""
    entries = [scene.document["presence"] for scene in scenes if "presence" in scene.document]
    present, absent = ([entry[kind] for entry in entries] for kind in ("present", "absent"))
    return PresenceCounts(
        present=sum(one["asked"] for one in present),
        answered=sum(one["answered"] for one in present),
        right=sum(one["right"] for one in present),
        absent=sum(one["asked"] for one in absent),
        answered_absent=sum(one["answered"] for one in absent),
    )
