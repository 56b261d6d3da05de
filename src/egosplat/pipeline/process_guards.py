"""Guards of a run's processes: stages end with their Snakemake, locks of a killed one go."""

import fcntl
import os
import shutil
import threading
import time
from pathlib import Path

from egosplat.errors import UserError
from egosplat.progress import log

STARTED_BY = "EGOSPLAT_STARTED_BY"
"""Environment variable with the process number of the Snakemake that started a stage; the workflow sets it."""

_SECONDS_BETWEEN_LOOKS = 1.0


def end_with_snakemake() -> None:
    """Watch, beside the work, the process that started this one, where the environment names it.

    Nothing is lost by the end: what is being written is not yet in place, and long stages have checkpoints.
    """
    number = os.environ.get(STARTED_BY, "")
    if number.isdigit():
        threading.Thread(target=_watch, args=(int(number),), daemon=True).start()


def _watch(process: int) -> None:
    while _alive(process):
        time.sleep(_SECONDS_BETWEEN_LOOKS)
    log("Snakemake is gone: this stage ends too; the same command goes on from here")
    os._exit(1)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


_HELD: list[int] = []


def clear_stale_locks(folder: Path) -> bool:
    """Remove the locks in Snakemake's ``folder`` unless a living Snakemake may hold them; whether there were any.

    Until the process ends it is noted as alive. On a file system without locks nothing is done, and `snakemake
    --unlock` is left to the user.
    """
    locks = folder / "locks"
    try:
        folder.mkdir(exist_ok=True)
        handle = os.open(folder / "alive", os.O_RDWR | os.O_CREAT)
    except OSError:
        return False  # a folder that cannot be written: Snakemake itself says so
    _HELD.append(handle)
    stale = _taken(handle, fcntl.LOCK_EX) and locks.is_dir() and any(locks.iterdir())
    if stale:
        shutil.rmtree(locks)
        locks.mkdir()
    _taken(handle, fcntl.LOCK_SH)
    return stale


def _taken(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def check_cores(cores: int | None, nodes: int | None) -> None:
    """Check that something can run: with no core, or no job at once, Snakemake waits without end.

    Args:
        cores: of ``--cores``; nodes: of ``--jobs`` on a cluster; None where not given.

    Raises:
        UserError: one of them is less than 1.
    """
    for option, count in (("--cores", cores), ("--jobs", nodes)):
        if count is not None and count < 1:
            raise UserError(f"{option} {count}: nothing can run; give 1 or more, as in {option} 2")
