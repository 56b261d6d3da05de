"""A stage ends when the Snakemake that started it is gone: the next one would start it a second time beside it."""

import os
import threading
import time

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
