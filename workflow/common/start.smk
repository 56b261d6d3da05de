"""
Checks before Snakemake writes anything or reads the configuration.

On a full disk Snakemake cannot write its log, and its message about a faulty configuration names no file.
"""

import sys
from pathlib import Path

from egosplat.errors import UserError
from egosplat.pipeline.config import check_config_files
from egosplat.files import check_writable
from egosplat.pipeline.home import config_file, presets_folder
from egosplat.pipeline.process_guards import check_cores, name_user
from egosplat.pipeline.snakemake_call import Call, read_call, tell_failures_at_exit

CONFIG_FILE = config_file()
PRESETS = presets_folder()

# The Snakemake of a job has no targets on its command line. The main process has done the checks.
IS_MAIN = workflow.is_main_process
CALL = read_call(sys.argv[1:]) if IS_MAIN else Call()

# sys.exit, because Snakemake prints a traceback for an exception.
try:
    if IS_MAIN:
        name_user()
        check_cores(workflow.resource_settings.cores, workflow.resource_settings.nodes)
        if CALL.makes_results:
            check_writable([Path(".snakemake"), Path("logs"), Path("results")])
    check_config_files([CONFIG_FILE, *workflow.overwrite_configfiles])
except UserError as error:
    sys.exit(f"egosplat: {error}")
