"""
The check of the targets, which needs the rules.
"""

import re

from egosplat.pipeline.results import Rules, check_words


def rules_made():
    """Get what the rules make."""
    every = list(workflow.rules)
    home = "results/{dataset}/{scene}/{variant}"
    # Without the constraints, which Snakemake writes into each wildcard.
    files = [
        re.sub(r",[^{}]*}", "}", str(path)) for rule in every for path in rule.output
    ]
    return Rules(
        plain=frozenset(
            [rule.name for rule in every if not rule.has_wildcards()]
            + [path for path in files if "{" not in path]
        ),
        of_scenes=frozenset(rule.name for rule in every if rule.has_wildcards()),
        outputs=frozenset(
            path.removeprefix(home) for path in files if path.startswith(home)
        ),
        is_made=lambda word: any(rule.is_producer(word) for rule in every),
    )


if IS_MAIN:
    try:
        check_words(CALL.targets, scenes, rules_made())
    except UserError as error:
        sys.exit(f"egosplat: {error}")
