"""The ledger's scenes and settings are those of the workflow."""

from benchmarks.ledger import __main__ as ledger


def test_every_setting_of_a_drawn_apartment_can_be_made(tmp_path, capfd):
    """Of a release too: the plan has the scores of each setting, and one recording for all of them."""
    (seed,) = ledger.draw_seeds("a text", count=1)
    settings = ledger.SETTINGS | {name: name for name in ledger.RELEASE}
    ledger.prepare(tmp_path, [seed])
    assert (
        ledger.snakemake(tmp_path, 1, [*ledger.scores_of([seed], settings)], "--dry-run", "--quiet", "rules")
        == 0
    )
    planned = capfd.readouterr().err
    counts = dict(line.split() for line in planned.splitlines() if len(line.split()) == 2)
    assert counts["metrics"] == str(len(settings)) and counts["synthetic"] == "1"
