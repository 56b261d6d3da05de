"""Run Snakemake's command line with a SLURM executor that checks its jobs every second.

The executor waits 10 s longer after each check at which no job has ended. In jobs of a few seconds most of the time is
such a wait, and no option limits it.
"""

import asyncio
import sys

from snakemake.cli import main
from snakemake_interface_executor_plugins.executors.remote import RemoteExecutor


async def _sleep(_: RemoteExecutor) -> None:
    await asyncio.sleep(1.0)


if __name__ == "__main__":
    RemoteExecutor.sleep = _sleep
    main(sys.argv[1:])
