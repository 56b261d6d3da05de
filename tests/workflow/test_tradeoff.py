"""The page of speed against accuracy plans exactly what its variants do not share."""

import json
import re
from collections import Counter

import pandas as pd
import pytest

from egosplat.artifacts.schemas import SCHEMAS

SCENE = "results/adt/scene1"
PAGE = f"{SCENE}/tradeoff/tradeoff.html"
VARIANTS = {
    "narrow": {"features": {"dims": 4}},
    "short": {"splats": {"iterations": 30}},
    "coarse": {"segments": {"points_per_side": 4}},
    "seed": {"run": {"seed": 1}},
    **{f"{name}_seed": {"extends": [name, "seed"]} for name in ("narrow", "coarse")},
}


def planned(workdir, *names: str) -> Counter[str]:
    """How many jobs of each rule the page of these variants would run."""
    config = {"variants": VARIANTS, "tradeoff": {"variants": names}}
    (workdir.folder / "more.yaml").write_text(json.dumps(config))
    done = workdir.snakemake("more.yaml", "--dry-run", "--quiet", "host", "--", PAGE)
    assert done.returncode == 0, done.stdout + done.stderr
    return Counter(re.findall(r"^(?:local)?rule (\w+):", done.stdout + done.stderr, re.MULTILINE))


@pytest.mark.parametrize(
    "names, expected",
    [
        ((), {"tradeoff": 1}),
        (("narrow", "short"), {"features": 1, "splats": 1, "language": 2, "metrics": 2, "tradeoff": 1}),
        # Of the seed: its instances and what follows; of each variant with it, what both reach.
        (
            ("narrow", "coarse", "seed", "narrow_seed", "coarse_seed"),
            {"segments": 1, "instances": 3, "view_features": 3, "features": 5, "transient": 1, "masks": 3}
            | {"splats": 3, "language": 5, "metrics": 5, "tradeoff": 1},
        ),
    ],
)
def test_variants_share_what_they_have_in_common(unchanged, names, expected):
    assert planned(unchanged, *names) == expected


@pytest.mark.slow
def test_a_page_of_one_variant_is_made_and_then_up_to_date(workdir):
    assert planned(workdir, "narrow")["tradeoff"] == 1
    done = workdir.snakemake("more.yaml", "--", PAGE)
    assert done.returncode == 0, done.stdout + done.stderr
    numbers = pd.read_csv((workdir.folder / PAGE).with_suffix(".csv")).fillna({"stage": ""})
    values = numbers.set_index(["point", "stage", "measure"])["value"]
    assert values["the scene", "", "psnr"] == values["narrow", "", "psnr"], "the same Gaussians"
    stages = {"", *SCHEMAS, "metrics"} - {"tiles", "histories"}
    assert set(values["narrow"].index.get_level_values("stage")) == stages
    assert values["narrow", "splats"].to_dict() == values["the scene", "splats"].to_dict()
    # metrics.json does not record its own size.
    assert values[values.isna()].index.get_level_values("measure").tolist() == ["disk_mb"] * 2
    assert planned(workdir, "narrow") == {}
    workdir.edit("egosplat_rivals/tradeoff/chart.py", "\ndef ", "\nCHANGED = 1\n\n\ndef ")
    assert planned(workdir, "narrow") == {"tradeoff": 1}
