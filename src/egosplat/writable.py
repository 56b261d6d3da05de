"""Whether what a run writes can be written, asked before anything is begun.

Snakemake writes its own notes beside the artifacts, and where it cannot it ends with a traceback.
"""

import re
import tempfile
from collections.abc import Iterable
from pathlib import Path

from egosplat.errors import MAKE_ROOM, NO_ROOM, UserError

_ROOM_BYTES = 2**20
"""Logs and notes of a run take less."""

_LOOKS = re.compile(
    r"-[nSDl]|--(dry-?run|report|(detailed-)?summary|(d3)?dag|rulegraph|filegraph|lint|l[citpu]|list(-\w+)*)"
)
"""Options of Snakemake with which it makes no results."""

_PLANS = re.compile(r"-n|--dry-?run")


def only_looks(words: list[str]) -> bool:
    """Whether a command line of Snakemake writes no results: it tells a workflow so only after it has read it."""
    looks = any(_LOOKS.fullmatch(word.partition("=")[0]) for word in words)
    return looks and "--report-after-run" not in words


def only_reports(words: list[str]) -> bool:
    """Whether a command line of Snakemake asks for its report of results that are there."""
    return only_looks(words) and any(word.partition("=")[0] == "--report" for word in words)


def only_plans(words: list[str]) -> bool:
    """Whether a command line of Snakemake is of a dry run."""
    return any(_PLANS.fullmatch(word) for word in words)


def check_writable(folders: Iterable[Path]) -> None:
    """Check that a file of a mebibyte can be made in each folder, or in the first one above it that is there.

    Nothing is left behind.

    Raises:
        UserError: a folder may not be written, or its disk is full.
    """
    for folder in dict.fromkeys(map(_nearest, folders)):
        try:
            with tempfile.NamedTemporaryFile(prefix=".egosplat-", dir=folder) as probe:
                probe.write(bytes(_ROOM_BYTES))
                probe.flush()
        except OSError as error:
            writable = "Results, logs and notes are written there: it has to be writable"
            advice = MAKE_ROOM if error.errno in NO_ROOM else writable
            raise UserError(f"{folder.absolute()}: {error.strerror}. {advice}") from None


def _nearest(folder: Path) -> Path:
    """The folder, or the first one above it that is there."""
    return next(each for each in (folder, *folder.absolute().parents) if each.is_dir())
