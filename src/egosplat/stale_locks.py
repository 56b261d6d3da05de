"""The locks of a Snakemake that was killed: gone when the next one starts, while living ones keep theirs.

Snakemake notes in files what it works on, and a killed one leaves them: the next refuses to start until it is told
`--unlock`. Here every Snakemake holds an operating system's lock beside them, which ends with the process: who
can have it alone is the only one alive.
"""

import fcntl
import os
import shutil
from pathlib import Path

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
