"""The configuration file, which is read here first: Snakemake's message about a faulty one names no file."""

import json
import os
import shlex
import sys
from functools import cache
from pathlib import Path

from egosplat.errors import UserError, user_message
from egosplat.pipeline.strict_yaml import read_yaml
from egosplat.pipeline.home import CONFIG, PRESETS, find_home
from egosplat.pipeline.process_guards import name_user


def or_exit(function, *given):
    """Call a function. A user's mistake ends the run with one line; an exception would give Snakemake's traceback."""
    try:
        return function(*given)
    except (UserError, OSError) as error:
        if (told := user_message(error)) is None:
            raise
        sys.exit(f"egosplat: {told}")


name_user()
# Snakemake takes the last of two values of a key.
for path in (find_home(CONFIG), *workflow.overwrite_configfiles):
    or_exit(read_yaml, Path(path))
