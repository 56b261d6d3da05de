"""The configuration file, which is read here first: Snakemake's message about a faulty one names no file."""

import json
import os
import shlex
import sys
from functools import cache
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.strict_yaml import read_yaml
from egosplat.pipeline.home import CONFIG, PRESETS, find_home
from egosplat.pipeline.process_guards import name_user


def or_exit(function, *given):
    """Call a function. A user's mistake ends the run with one line; an exception would give Snakemake's traceback."""
    try:
        return function(*given)
    except UserError as error:
        sys.exit(f"egosplat: {error}")


name_user()
or_exit(read_yaml, find_home(CONFIG))
