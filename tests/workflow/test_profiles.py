"""Each rule names the inputs of its own stage and asks a cluster for its needs; the profile speaks of rules that there are."""

import re
from pathlib import Path

import pytest
import yaml

from egosplat.pipeline.costs import can_use_gpu
from egosplat.pipeline.stages import STAGES

WORKFLOW = Path(__file__).parents[2] / "workflow"
TEXT = "".join(path.read_text() for path in sorted((WORKFLOW / "rules").glob("*.smk")))
RULES = dict(re.findall(r"^(?:rule|checkpoint) (\w+):\n((?:(?:    .*)?\n)*)", TEXT, re.MULTILINE))
SHEETS = set(re.findall(r'^    "(\w+_sheet)": ', TEXT, re.MULTILINE))
"""The sheets, whose rule is in a loop over their names."""
LOCAL = set(re.findall(r"\w+", " ".join(re.findall(r"^localrules:\n((?:    .*\n)*)", TEXT, re.MULTILINE))))
PROFILE = yaml.safe_load((WORKFLOW / "profiles/slurm/config.yaml").read_text())


@pytest.mark.parametrize("stage", sorted(set(STAGES) - SHEETS))
def test_a_rule_names_the_inputs_of_its_stage(stage):
    """The command's flags come from the stage's record, what Snakemake waits for from the rule."""
    about, body = STAGES[stage], RULES[stage]
    named = dict(re.findall(r'^        (\w+)=(shared\("[\w.]+"\)|recording),', body, re.MULTILINE))
    paths = {name: f'shared("{STAGES[name].output}")' for name in about.inputs if name in STAGES}
    paths |= {"recording": "recording"} if "recording" in about.inputs else {}
    assert named == paths
    assert (f'**configured("{stage}")' in body) == bool(about.optional or about.by_chunks)
    assert f'**params("{stage}")' in body


@pytest.mark.parametrize("rule", sorted(set(RULES) - LOCAL))
def test_a_rule_asks_for_what_its_own_stage_needs(rule):
    """By the law of its own stage; by plain numbers where no law is measured."""
    assert f'**request("{rule}")' in RULES[rule] or re.search(r"mem_mb=\d+,\s+runtime=\d+,", RULES[rule])


def test_rules_that_use_a_gpu_ask_for_it():
    asking = {rule for rule, body in RULES.items() if f'**request("{rule}")' in body and can_use_gpu(rule)}
    assert asking >= {"segments", "instances", "view_features", "transient", "splats", "language", "metrics"}
    assert not asking & {"frames", "annotations", "poses", "survey", "features", "masks"}


def test_every_stage_has_a_rule_and_the_profile_names_no_other():
    assert {*STAGES} <= {*RULES} | SHEETS
    grouped = dict(entry.split("=") for entry in PROFILE["groups"])
    assert set(grouped) <= (set(RULES) | SHEETS) - LOCAL
    assert {rule for rule, group in grouped.items() if group == "sheets"} - {"methods_sheet"} == SHEETS
    assert PROFILE["executor"] == "slurm" and "default-resources" not in PROFILE
