"""An alarm of a stage is in its log, in the scores, in the log of the scores and on the page of tables."""

import json

from egosplat.artifacts.schemas import SCHEMAS

SCENE = "results/adt/scene1"
KEY = "features.reconstruction"


def alarms(folder) -> list[str]:
    return [alarm["key"] for alarm in json.loads((folder / SCENE / "metrics.json").read_text())["alarms"]]


def logged(folder, stage: str) -> list[str]:
    lines = (folder / "logs/adt/scene1" / f"{stage}.log").read_text().splitlines()
    return [line.split(": ")[2] for line in lines if line.startswith(f"{stage}: alarm: ")]


def test_an_alarm_reaches_the_log_the_scores_and_the_tables(workdir):
    assert KEY not in alarms(workdir.folder), "a normal run has none"
    # Codes that tell hardly anything apart.
    (workdir.folder / "more.yaml").write_text("features: {compression: linear, dims: 1}")
    done = workdir.snakemake("more.yaml", "--", f"{SCENE}/metrics.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert logged(workdir.folder, "features") == [KEY]
    found = alarms(workdir.folder)
    assert KEY in found and logged(workdir.folder, "metrics") == found


def test_the_scores_hold_every_alarm_that_a_stage_logged(finished):
    folder = finished.folder
    of_stages = [
        key for stage in SCHEMAS if stage not in ("tiles", "histories") for key in logged(folder, stage)
    ]
    assert [key for key in alarms(folder) if not key.startswith("metrics.")] == of_stages
    assert "transient.probability" in alarms(folder), "20 iterations teach the network nothing"
