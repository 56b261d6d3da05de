"""Guards of a run's processes: stages exit with their Snakemake, and stale locks are removed."""

import contextlib
import fcntl
import getpass
import os
import shutil
import subprocess
import threading
import time
from pathlib import Path

from egosplat.progress import log

# Environment variable with the process id of the Snakemake that started a stage. The workflow sets it.
STARTED_BY = "EGOSPLAT_STARTED_BY"


def end_with_snakemake() -> None:
    """Exit when the parent Snakemake dies, so that a restart does not run the stage twice. Watches in a thread."""
    number = os.environ.get(STARTED_BY, "")

    def watch() -> None:
        with contextlib.suppress(ProcessLookupError):
            while True:
                with contextlib.suppress(PermissionError):
                    os.kill(int(number), 0)  # signal 0 is not sent; only the process id is checked
                time.sleep(1.0)
        log("Snakemake ended, so this stage ends too; the same command continues from here")
        # Not ``sys.exit``, which in a thread ends only the thread. Nothing is lost: unfinished outputs are not yet in place, and
        # long stages have checkpoints.
        os._exit(1)

    if number.isdecimal():
        threading.Thread(target=watch, daemon=True).start()


# File descriptors that stay open until the process ends, and with them their locks.
_HELD: list[int] = []


def clear_stale_locks(folder: Path) -> bool:
    """Remove the locks in Snakemake's ``folder`` unless a running Snakemake may hold them, and tell whether there were any.

    This process counts as running until it ends. Jobs in SLURM's queue outlive a killed Snakemake, so locks of their folder
    stay. On a file system without file locks nothing is removed, and the user has to call `snakemake --unlock`.
    """
    locks = folder / "locks"
    try:
        folder.mkdir(exist_ok=True)
        handle = os.open(folder / "alive", os.O_RDWR | os.O_CREAT)
    except OSError:
        return False  # Snakemake itself reports a folder that cannot be written
    _HELD.append(handle)
    is_stale = _take(handle, fcntl.LOCK_EX) and locks.is_dir() and any(locks.iterdir())
    if is_stale and shutil.which("squeue"):
        words = ["squeue", "--me", "--noheader", "--format=%Z"]  # the folders of the user's jobs
        listed = subprocess.run(words, capture_output=True, text=True, check=False).stdout
        is_stale = str(folder.absolute().parent) not in map(str.strip, listed.splitlines())
    if is_stale:
        shutil.rmtree(locks)
        locks.mkdir()
    # A shared lock: several runs may be alive, and each keeps the others from clearing the locks.
    _take(handle, fcntl.LOCK_SH)
    return is_stale


def _take(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def name_user() -> None:
    """Name the user by number where the system has no name, as in a container: Snakemake asks for one when it starts."""
    try:
        getpass.getuser()
    except (KeyError, OSError):
        os.environ["USER"] = str(os.getuid())
