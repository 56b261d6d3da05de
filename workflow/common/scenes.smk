"""The table of scenes, the locks of a Snakemake that was killed, and the beginning of every shell command."""

from egosplat.pipeline.config import resolve
from egosplat.pipeline.home import SETTINGS
from egosplat.pipeline.process_guards import (
    STARTED_BY,
    clear_stale_locks,
    end_with_snakemake,
)
from egosplat.pipeline.scenes import default_scenes, find_scene, is_own
from egosplat.pipeline.variants import read_scenes_with_presets

# As a step ends with its Snakemake, Snakemake ends with the egosplat run that started it.
end_with_snakemake()
# Jobs on other machines start with this environment.
is_of_run = os.environ.pop(STARTED_BY, None) is not None

presets = find_home(PRESETS)
settings = or_exit(resolve, config, presets)
scenes = or_exit(read_scenes_with_presets, settings, presets)

# A killed Snakemake leaves its locks. Removing them lets the same command continue without --unlock, but not while its jobs on a
# cluster are queued or run.
if clear_stale_locks(Path(".snakemake")):
    print("The last Snakemake here was killed: continuing.", file=sys.stderr)

# A killed command cannot report itself. `|| true` keeps the command's own exit status.
TELL_IF_KILLED = workflow.source_path("../scripts/tell_if_killed.sh")
AT_EXIT = f"sh {shlex.quote(TELL_IF_KILLED)} $? || true"

# What the command sets beside the configuration file, as words of --config, for artifacts to record; the address of a container,
# which changes no result, may hold a password.
usual = read_yaml(find_home(CONFIG)) | {"container": config.get("container")}
given = sorted((key, value) for key, value in config.items() if usual.get(key) != value)
texts = (
    (key, value if isinstance(value, str) else json.dumps(value))
    for key, value in given
)
given_settings = shlex.quote(shlex.join(f"{key}={text}" for key, text in texts))

# The first line repeats Snakemake's own prefix, which this one replaces: pipefail reports a failure before the pipe to
# the log. PATH names the environment of Snakemake, which may not be activated.
shell.prefix(
    "set -euo pipefail; "
    f"trap {shlex.quote(AT_EXIT)} EXIT; "
    f"export PATH={shlex.quote(os.path.dirname(sys.executable))}:$PATH; "
    f"export {STARTED_BY}=$PPID; "
    f"export {SETTINGS}={given_settings.replace('{', '{{').replace('}', '}}')}; "
)


wildcard_constraints:
    dataset="[a-z0-9_]+",
    scene="[A-Za-z0-9_-]+",
    variant="(variants/[A-Za-z0-9_-]+/)?",
    chunk="[0-9]+",
