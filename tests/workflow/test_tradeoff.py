"""The page of speed against accuracy plans exactly what its points do not share."""

import json
import re
from collections import Counter

import pytest
from click.testing import CliRunner

from benchmarks.tradeoff import __main__ as benchmark
from egosplat.pipeline.config import defaults
from egosplat.pipeline.stages import ARTIFACTS
from tests.support.tables import cells

SCENE = "results/adt/scene1"
DIMS = defaults()["features"]["dims"]
PAGE = f"{SCENE}/tradeoff/tradeoff.html"


def points(seeds=(), presets=(), **knobs) -> str:
    """Configuration; knobs as ``features__dims=[8]``."""
    named = {name.replace("__", "."): values for name, values in knobs.items()}
    return json.dumps({"tradeoff": {"seeds": list(seeds), "presets": list(presets), "sweep": named}})


def planned(workdir, config: str) -> Counter[str]:
    """How many jobs of each rule the page would run."""
    (workdir.folder / "more.yaml").write_text(config)
    done = workdir.snakemake("more.yaml", "--dry-run", "--quiet", "host", "--", PAGE)
    assert done.returncode == 0, done.stdout + done.stderr
    return Counter(re.findall(r"^(?:local)?rule (\w+):", done.stdout + done.stderr, re.MULTILINE))


@pytest.mark.parametrize(
    "config, expected",
    [
        (points(), {"tradeoff": 1}),
        (
            points(features__dims=[4], splats__iterations=[30]),
            {"features": 1, "splats": 1, "language": 2, "metrics": 2, "tradeoff": 1},
        ),
        # Of the seed: its instances and what follows; of each point with it, what both reach.
        (
            points(seeds=[1], features__dims=[4], segments__points_per_side=[4]),
            {
                "segments": 1,
                "instances": 3,
                "view_features": 3,
                "features": 5,
                "transient": 1,
                "masks": 3,
                "splats": 3,
            }
            | {"language": 5, "metrics": 5, "tradeoff": 1},
        ),
    ],
)
def test_points_share_what_they_have_in_common(unchanged, config, expected):
    assert planned(unchanged, config) == expected


def test_the_paper_scaled_shares_pictures_and_poses(unchanged):
    found = planned(unchanged, points(presets=["paper_scaled"]))
    assert set(found).isdisjoint({"frames", "annotations", "poses"})
    assert found["segments"] == found["splats"] == found["metrics"] == 1


def test_a_page_of_one_knob_is_made_and_then_up_to_date(workdir):
    narrow = points(features__dims=[4])
    (workdir.folder / "mine.yaml").write_text(narrow)
    done = workdir.snakemake("mine.yaml", "--", PAGE)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((workdir.folder / PAGE).with_suffix(".json").read_text())
    assert [one["label"] for one in document["points"]] == ["the scene", "features.dims=4"]
    own, small = document["points"]
    assert own["measures"]["psnr"] == small["measures"]["psnr"]  # the same Gaussians
    assert own["settings"] == [{"knob": "features.dims", "value": DIMS}]
    assert set(small["stages"]) == {*ARTIFACTS, "metrics"} - {"tiles", "carries", "rests"}
    assert small["stages"]["splats"] == own["stages"]["splats"] != small["stages"]["features"]
    # metrics.json does not record its own size.
    costs = [cost for stage in small["stages"].values() for name, cost in stage.items() if name != "disk_mb"]
    assert costs and None not in costs
    assert planned(workdir, narrow) == {}
    table = CliRunner().invoke(benchmark.main, [str(workdir.folder / SCENE)], catch_exceptions=False)
    assert [row[0].strip("*") for row in cells(table.stdout)[1:]] == ["the scene", "features.dims=4"]
    workdir.edit("egosplat_rivals/tradeoff/estimates.py", "\ndef ", "\nCHANGED = 1\n\n\ndef ")
    assert planned(workdir, narrow) == {"tradeoff": 1}
