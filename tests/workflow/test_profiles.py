"""Each rule asks a cluster for what its own stage needs, and the profile speaks of rules that there are."""

import re
from pathlib import Path

import pytest
import yaml

WORKFLOW = Path(__file__).parents[2] / "workflow"
RULES = {
    name: body
    for path in sorted((WORKFLOW / "rules").glob("*.smk"))
    for name, body in re.findall(
        r"^(?:rule|checkpoint) (\w+):\n((?:(?:    .*)?\n)*)", path.read_text(), re.MULTILINE
    )
}
SNAKEFILE = (WORKFLOW / "Snakefile").read_text()
LOCAL = set(
    re.findall(r"^    (\w+),$", SNAKEFILE.partition("localrules:")[2].partition("rule ")[0], re.MULTILINE)
)
PROFILE = yaml.safe_load((WORKFLOW / "profiles/slurm/config.yaml").read_text())


@pytest.mark.parametrize("rule", sorted(set(RULES) - LOCAL))
def test_a_rule_asks_for_what_its_own_stage_needs(rule):
    assert f'mem_mb=memory("{rule}"),' in RULES[rule]
    assert f'runtime=runtime("{rule}"),' in RULES[rule]
    assert set(re.findall(r'gpus\("(\w+)"\)', RULES[rule])) <= {rule}


def test_rules_that_use_a_gpu_ask_for_it():
    asking = {rule for rule, body in RULES.items() if "gpu=gpus(" in body}
    assert asking == {"segments", "view_features", "transient", "splats", "language", "metrics"}


def test_the_profile_names_existing_rules():
    grouped = dict(entry.split("=") for entry in PROFILE["groups"])
    assert set(grouped) <= set(RULES) - LOCAL
    assert {rule for rule, group in grouped.items() if group == "sheets"} == {
        rule for rule in RULES if rule.endswith("_sheet")
    }
    assert PROFILE["executor"] == "slurm" and "default-resources" not in PROFILE
