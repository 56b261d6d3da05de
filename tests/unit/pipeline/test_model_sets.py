"""One key switches the models together with the thresholds that suit them."""

import json
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline import config
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.model_sets import CATALOGUE, DEFAULTS, LIBRARIES, locate_checkpoints, named_model
from egosplat.pipeline.options import keys_of
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.variants import reaches, scene_config, variant_config
from tests.support import HEADER, PRESETS
from tests.support.tables import scenes_of

PUBLISHED, SMALL = ({"models": {"set": name}} for name in ("published", "small"))
VALUES = DEFAULTS["published"]
FOLLOW = [(section, name) for section, keys in VALUES.items() for name in keys]


def resolved(**user):
    return config.resolve(user, PRESETS)


def scene(tmp_path: Path, format: str = "plain", options: str = "", recording: str = "r", **user) -> Scene:
    """The only scene of a table."""
    row = f"mine\ts\t{format}\t{recording}\t{options}\n"
    (found,) = scenes_of(tmp_path, HEADER + row, **user).values()
    return found


def follow(found, models: str) -> bool:
    """Whether all keys that follow the set have the set's values."""
    return all(found[section].items() >= keys.items() for section, keys in DEFAULTS[models].items())


def test_the_values_of_the_small_models_are_the_defaults_of_the_options():
    usual = config.configure([])
    assert DEFAULTS["small"] == {s: {key: usual[s][key] for key in keys} for s, keys in VALUES.items()}


@pytest.mark.parametrize("preset", keys_of(GeneralOptions)["preset"]["enum"])
def test_the_set_decides_with_every_preset(preset):
    published, small = (resolved(preset=preset, models={"set": name}) for name in ("published", "small"))
    assert follow(published, "published") and follow(small, "small")
    same = {s: {key for key, value in small[s].items() if published[s][key] == value} for s in VALUES}
    assert {(s, key) for s in VALUES for key in {*small[s]} - same[s]} == {("models", "set"), *FOLLOW}
    assert {s for s in published if published[s] != small[s]} == set(VALUES)
    assert follow(resolved(preset=preset), "published" if preset == "paper" else "small")


@pytest.mark.parametrize(
    "format, options, metadata, user, expected",
    [
        ("plain", "", None, {}, "photos"),
        ("adt", "", None, {}, "photos"),
        ("adt", "", {"origin": "synthetic"}, {}, "small"),
        ("adt", "", {"origin": "real"}, {}, "photos"),
        ("adt", "synthetic.seed=1", None, {"formats": {"plain": PUBLISHED}}, "small"),
        ("plain", "", None, {"formats": {"plain": PUBLISHED}}, "published"),
        ("plain", "models.set=small", None, {"preset": "paper"}, "small"),
        ("plain", "models.set=published", None, {}, "published"),
    ],
)
def test_a_scene_takes_the_set_that_is_chosen_or_that_suits_its_recording(
    tmp_path, format, options, metadata, user, expected
):
    """Apartments take the small models, what was filmed takes words for photographs; published models are asked for."""
    recording = tmp_path / "recording"
    recording.mkdir()
    if metadata is not None:
        (recording / "metadata.json").write_text(json.dumps(metadata))
    found = scene(tmp_path, format, options, recording=str(recording), **user).config
    assert found["models"]["set"] == expected and follow(found, expected)


@pytest.mark.parametrize(
    "options, user, models, asked",
    [
        ("", {"query": {"min_score": 0.5}}, "photos", 0.5),
        ("query.min_score=0.7", {}, "photos", 0.7),  # the small models' default is a choice here
        ("", {"formats": {"plain": {"query": {"min_score": 0.7}}}}, "photos", 0.7),
        ("models.set=auto query.min_score=0.7", PUBLISHED, "photos", 0.7),
        ("", PUBLISHED | {"query": {"min_score": 0.5}}, "published", 0.5),
        ("", {"formats": {"plain": PUBLISHED | {"query": {"min_score": 0.5}}}}, "published", 0.5),
    ],
)
def test_a_key_of_the_user_wins_over_the_set(tmp_path, options, user, models, asked):
    found = scene(tmp_path, options=options, **user).config
    assert (found["models"]["set"], found["query"]["min_score"]) == (models, asked)
    assert found["query"]["temperature"] == DEFAULTS[models]["query"]["temperature"]


def test_a_variant_may_choose_a_set_and_keeps_the_users_keys():
    back = {name: {"extends": "other", "models": {"set": name}} for name in ("small", "auto")}
    base = resolved(variants={"other": PUBLISHED} | back, **SMALL)
    assert follow(variant_config(base, "other", "s"), "published")
    for name in back:
        assert follow(variant_config(base, name, "s"), "small")
        assert variant_config(base, name, "s")["models"]["set"] == "small"
    own = {"query": {"temperature": 5.0}, "models": {"set": "published", "clip_checkpoint": "mine.bin"}}
    small = variant_config(resolved(**own, variants={"back": SMALL}), "back", "s")
    assert (small["query"]["temperature"], small["query"]["min_score"]) == (5.0, 0.7)
    assert small["models"]["clip_checkpoint"] == "mine.bin" and small["models"]["sam2_checkpoint"] == "small"


def test_exactly_the_stages_with_a_key_of_the_set_change():
    small, published = resolved(), locate_checkpoints(resolved(**PUBLISHED))
    values = {stage: [config.stage_values(stage, one) for one in (small, published)] for stage in STAGES}
    assert {stage for stage, (usual, other) in values.items() if usual != other} == {
        *("transient", "segments", "tiles", "view_features", "features", "histories", "metrics", "scene_page")
    }
    same = {stage for stage in STAGES if not reaches(stage, small, published)}
    assert same - {"synthetic"} == {"frames", "annotations", "poses", "survey", "contact_sheet"}


def test_published_checkpoints_are_files_of_the_cache(tmp_path):
    keys = {"set": "published", "cache": "/data/models"}
    found = scene_config(scene(tmp_path, models=keys), None)
    assert found["models"]["sam2_checkpoint"] == "/data/models/sam2.1_hiera_base_plus.pt"
    assert found["models"]["clip_checkpoint"] == "/data/models/ViT-B-16.laion2b_s34b_b88k.bin"
    encoder = "/data/models/mobilenetv3_small_050.lamb_in1k.safetensors"
    assert found["transient"]["encoder_weights"] == encoder
    for spelling in ("sam2.1_hiera_l", "configs/sam2.1/sam2.1_hiera_l.yaml"):
        large = locate_checkpoints(
            resolved(models=keys | {"sam2_config": spelling, "clip_model": "ViT-B-16-quickgelu"})
        )
        assert large["models"]["sam2_checkpoint"] == "/data/models/sam2.1_hiera_large.pt"
        assert large["models"]["clip_checkpoint"] == "/data/models/ViT-B-16-quickgelu.dfn2b.bin"


def test_the_page_lists_every_key_that_follows_the_set():
    lines = (PRESETS.parents[1] / "docs/models.md").read_text().splitlines()
    for section, name in FOLLOW:
        (row,) = [line for line in lines if line.startswith("| `") and f"`{section}.{name}`" in line]
        for cell, models in zip(row.replace("`", "").split("|")[2:4], ("small", "published"), strict=True):
            value = DEFAULTS[models][section][name]
            written = f"{value:g}" if isinstance(value, float) else str(value)
            assert ("null" if value is None else written) in cell, row


def test_the_catalogue_is_consistent(monkeypatch):
    for one in CATALOGUE:
        assert one.library in LIBRARIES.values() and one.address.startswith("https://huggingface.co/")
        assert named_model(one.file) is named_model(one.architecture) is one
    with pytest.raises(UserError, match="ViT-B-17: .*ViT-B-16"):
        named_model("ViT-B-17")
    monkeypatch.setenv("HF_ENDPOINT", "https://mirror.example/")
    assert named_model("ViT-B-16").address.startswith("https://mirror.example/laion/CLIP")
    assert named_model("sam2.1_hiera_t").address.endswith(
        "/facebook/sam2.1-hiera-tiny/resolve/main/sam2.1_hiera_tiny.pt"
    )
