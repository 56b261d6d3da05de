"""A notice is given exactly if small checkpoints are used on a real recording."""

from types import SimpleNamespace

import pytest

from egosplat.models.suitability import configured_checkpoints, notice, notice_of_artifacts

BOTH = {"sam2_checkpoint": "small", "clip_checkpoint": "small"}
SAM2 = {"sam2_checkpoint": "small", "clip_checkpoint": "clip.bin"}
WORDS = {"sam2_checkpoint": "small", "clip_checkpoint": "photos"}


def artifact(origin: str, models: dict[str, str], **facts):
    """A stand-in for an artifact with an origin, and the checkpoints of its provenance."""
    made = {"options": models, "models": dict.fromkeys(models, "c0de")}
    return SimpleNamespace(origin=origin, provenance=made, facts=facts)


@pytest.mark.parametrize(
    "origin, checkpoints, aria, said",
    [
        ("real", BOTH, False, ["apartments only", "sam2_checkpoint", "clip_checkpoint", "to published"]),
        ("real", SAM2, False, ["models.sam2_checkpoint", "egosplat models download"]),
        # Words for photographs know the classes of ImageNet; none of them suits Aria glasses.
        ("real", WORDS, False, ["models.set photos", "ImageNet", "to published"]),
        ("real", WORDS, True, ["models.set photos", "unreliable", "to published"]),
        ("real", {"sam2_checkpoint": "sam2.pt", "clip_checkpoint": "clip.bin"}, False, []),
        ("real", {}, False, []),
        ("synthetic", BOTH, False, []),
        ("synthetic", WORDS, False, []),
    ],
)
def test_models_that_do_not_suit_the_recording_are_reported_with_what_to_do(origin, checkpoints, aria, said):
    told = notice(origin, checkpoints, aria=aria)
    assert (told is None) == (not said) and "\n" not in (told or "")
    assert all(words in (told or "") for words in said)
    assert checkpoints is not SAM2 or "clip" not in told


def test_artifacts_are_reported_by_their_provenance():
    segments = artifact("real", {"sam2_checkpoint": "small"})
    frames = artifact("real", {})
    assert notice_of_artifacts([frames]) is None
    assert notice_of_artifacts([frames, segments]) == notice("real", {"sam2_checkpoint": "small"})
    features = artifact("real", {}, clip={"checkpoint": "small"})
    assert notice_of_artifacts([frames, segments, features]) == notice("real", BOTH)
    assert notice_of_artifacts([artifact("synthetic", {}), segments]) is None
    # Aria glasses are known by their device frame.
    for frame, aria in ([[1.0]], True), (None, False):
        used = [artifact("real", WORDS), artifact("real", {}, device_from_camera=frame)]
        assert notice_of_artifacts(used) == notice("real", WORDS, aria=aria)


def test_sam2_counts_only_where_it_segments():
    config = {"models": BOTH, "segments": {"segmenter": "sam2"}}
    assert configured_checkpoints(config) == BOTH
    config["segments"]["segmenter"] = "classical"
    assert configured_checkpoints(config) == {"clip_checkpoint": "small"}
