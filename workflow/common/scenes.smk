"""
The table of scenes, the notices before a run, and the beginning of every shell command.
"""

import os
import shlex
from functools import cache

from egosplat.doctor.inputs import left_out_notices, plan_notices
from egosplat.pipeline import config as configuration
from egosplat.pipeline.process_guards import STARTED_BY, clear_stale_locks
from egosplat.pipeline.scenes import find_scene, requested_targets
from egosplat_rivals.compared import compared_variants
from egosplat.pipeline.variants import check_target, read_scenes_with_presets

try:
    scenes = read_scenes_with_presets(configuration.resolve(config, PRESETS), PRESETS)
    targets = requested_targets(CALL.targets)
    for target in targets:
        check_target(scenes, target)
        if target.name.startswith("tradeoff/"):
            compared_variants(scenes[target.dataset, target.scene])
except UserError as error:
    sys.exit(f"egosplat: {error}")

if IS_MAIN:
    notices = [*plan_notices(scenes, targets), *left_out_notices(scenes, targets)]
    for line in notices:
        print(f"egosplat: {line}", file=sys.stderr)

# A killed Snakemake leaves its locks. Removing them lets the same command continue without --unlock. Jobs on a cluster
# outlive a killed Snakemake, so their locks stay; only --jobs, the number of submitted jobs, shows a cluster here.
if IS_MAIN and workflow.resource_settings.nodes is None:
    if clear_stale_locks(Path(".snakemake")):
        print("The last Snakemake here was killed: continuing.", file=sys.stderr)

# A killed command cannot report itself. `|| true` keeps the command's own exit status.
TELL_IF_KILLED = str(Path(workflow.basedir) / "scripts/tell_if_killed.sh")
AT_EXIT = f"sh {shlex.quote(TELL_IF_KILLED)} $? || true"

# The first line repeats Snakemake's own prefix, which this one replaces: pipefail reports a failure before the pipe to
# the log. PATH names the environment of Snakemake, which may not be activated.
shell.prefix(
    "set -euo pipefail; "
    f"trap {shlex.quote(AT_EXIT)} EXIT; "
    f"export PATH={shlex.quote(os.path.dirname(sys.executable))}:$PATH; "
    f"export {STARTED_BY}=$PPID; "
)


wildcard_constraints:
    dataset="[a-z0-9_]+",
    scene="[A-Za-z0-9_-]+",
    variant="(variants/[A-Za-z0-9_-]+/)?",
    chunk="[0-9]+",
