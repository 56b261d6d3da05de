"""A notice is given exactly if small checkpoints are used on a real recording."""

from types import SimpleNamespace

import pytest

from egosplat.models.suitability import configured_checkpoints, notice, notice_of_artifacts

BOTH = {"sam2_checkpoint": "small", "clip_checkpoint": "small"}


def artifact(origin: str, models: dict[str, str], **facts):
    """A stand-in for an artifact with an origin, and the checkpoints of its provenance."""
    made = {"options": models, "models": dict.fromkeys(models, "c0de")}
    return SimpleNamespace(origin=origin, provenance=made, facts=facts)


def test_a_real_recording_with_small_checkpoints_is_reported_with_what_to_do():
    told = notice("real", BOTH)
    assert "\n" not in told and "synthetic apartments only" in told
    assert "models.sam2_checkpoint" in told and "models.clip_checkpoint" in told
    assert "models.set to published" in told and "egosplat models download" in told


@pytest.mark.parametrize(
    "origin, checkpoints",
    [
        ("synthetic", BOTH),
        ("real", {"sam2_checkpoint": "sam2.pt", "clip_checkpoint": "clip.bin"}),
        ("real", {}),
    ],
)
def test_matching_models_and_recording_give_no_notice(origin, checkpoints):
    assert notice(origin, checkpoints) is None


def test_the_notice_names_only_the_small_checkpoint():
    told = notice("real", {"sam2_checkpoint": "small", "clip_checkpoint": "clip.bin"})
    assert "models.sam2_checkpoint" in told and "clip" not in told


def test_words_for_photographs_have_limits_and_none_of_them_suits_aria_glasses():
    """The notice of artifacts knows the glasses by their device frame."""
    words = {"sam2_checkpoint": "small", "clip_checkpoint": "photos"}
    plain, aria = notice("real", words), notice("real", words, aria=True)
    assert "models.set photos" in plain and "ImageNet" in plain and "to published" in plain
    assert "models.set photos" in aria and "unreliable" in aria and "to published" in aria
    assert notice("synthetic", words) is None and "\n" not in plain + aria
    used = artifact("real", words)
    assert notice_of_artifacts([used]) == plain
    assert notice_of_artifacts([used, artifact("real", {}, device_from_camera=[[1.0]])]) == aria
    assert notice_of_artifacts([used, artifact("real", {}, device_from_camera=None)]) == plain


def test_artifacts_are_reported_by_their_provenance():
    segments = artifact("real", {"sam2_checkpoint": "small"})
    frames = artifact("real", {})
    assert notice_of_artifacts([frames]) is None
    assert notice_of_artifacts([frames, segments]) == notice("real", {"sam2_checkpoint": "small"})
    features = artifact("real", {}, clip={"checkpoint": "small"})
    assert notice_of_artifacts([frames, segments, features]) == notice("real", BOTH)
    assert notice_of_artifacts([artifact("synthetic", {}), segments]) is None


def test_sam2_counts_only_where_it_segments():
    config = {"models": BOTH, "segments": {"segmenter": "sam2"}}
    assert configured_checkpoints(config) == BOTH
    config["segments"]["segmenter"] = "classical"
    assert configured_checkpoints(config) == {"clip_checkpoint": "small"}
