"""Each rule asks a cluster for what its own stage needs, and the profile speaks of rules that there are."""

import re
from pathlib import Path

import pytest
import yaml

WORKFLOW = Path(__file__).parents[2] / "workflow"
TEXT = "".join(path.read_text() for path in sorted((WORKFLOW / "rules").glob("*.smk")))
RULES = dict(re.findall(r"^(?:rule|checkpoint) (\w+):\n((?:(?:    .*)?\n)*)", TEXT, re.MULTILINE))
SHEET = re.search(r"^    rule:\n((?:(?:        .*)?\n)*)", TEXT, re.MULTILINE)[1]
"""The rule of all sheets, in a loop over their names."""
RULES |= {
    name: SHEET.replace("(sheet)", f'("{name}")')
    for name in re.findall(r'^    "(\w+_sheet)": ', TEXT, re.MULTILINE)
}
LOCAL = set(re.findall(r"\w+", " ".join(re.findall(r"^localrules:\n((?:    .*\n)*)", TEXT, re.MULTILINE))))
PROFILE = yaml.safe_load((WORKFLOW / "profiles/slurm/config.yaml").read_text())


@pytest.mark.parametrize("rule", sorted(set(RULES) - LOCAL))
def test_a_rule_asks_for_what_its_own_stage_needs(rule):
    """By the law of its own stage; by plain numbers where no law is measured."""
    assert re.search(rf'mem_mb=(memory\("{rule}"\)|\d+),', RULES[rule])
    assert re.search(rf'runtime=(runtime\("{rule}"\)|\d+),', RULES[rule])
    assert set(re.findall(r'gpus\("(\w+)"\)', RULES[rule])) <= {rule}


def test_rules_that_use_a_gpu_ask_for_it():
    asking = {rule for rule, body in RULES.items() if "gpu=gpus(" in body}
    assert asking == {
        "segments",
        "instances",
        "tiles",
        "view_features",
        "transient",
        "splats",
        "language",
        "histories",
        "metrics",
    }


def test_the_profile_names_existing_rules():
    grouped = dict(entry.split("=") for entry in PROFILE["groups"])
    assert set(grouped) <= set(RULES) - LOCAL
    assert {rule for rule, group in grouped.items() if group == "sheets"} == {
        rule for rule in RULES if rule.endswith("_sheet")
    }
    assert PROFILE["executor"] == "slurm" and "default-resources" not in PROFILE
