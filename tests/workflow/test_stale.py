"""Only stale steps rerun."""

import json
import os
import re
import shutil
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from safetensors.torch import save_file

from egosplat.transient.network import make_network
from tests.unit.frames.conftest import grey_frames, write_video

POSES = "results/adt/scene1/poses.zarr"
AFTER_QUERIES = {"metrics", "queries_sheet"}
AFTER_LANGUAGE = {"language", "scene_page", *AFTER_QUERIES}
AFTER_SPLATS = {"splats", "splats_sheet", "transient_sheet", *AFTER_LANGUAGE}
AFTER_MASKS = {"masks", *AFTER_SPLATS}
AFTER_TRANSIENT = {"transient", *AFTER_MASKS}
AFTER_FEATURES = {"features", "crops_sheet", *AFTER_LANGUAGE}
AFTER_VIEWS = {"view_features", *AFTER_FEATURES}
AFTER_INSTANCES = {"instances", "instances_sheet", *AFTER_MASKS, *AFTER_VIEWS}
AFTER_SEGMENTS = {"segments", *AFTER_INSTANCES}
AFTER_POSES = {"poses", "contact_sheet", *AFTER_TRANSIENT, *AFTER_INSTANCES}
AFTER_GAUSSIANS = {*AFTER_TRANSIENT, *AFTER_INSTANCES}
AFTER_FRAMES = {"frames", "annotations", *AFTER_POSES, *AFTER_SEGMENTS}


def test_a_finished_run_has_nothing_to_do(workdir):
    assert workdir.stale(*workdir.MAIN) == set()
    assert "Nothing to be done" in workdir.run(POSES)


SMALL_AGAIN = """
models: {set: published, sam2_config: small, sam2_checkpoint: small, clip_model: small, clip_checkpoint: small}
segments: {image_size: 512}
transient: {encoder_weights: null}
"""


@pytest.mark.parametrize(
    "config, expected",
    [
        ("poses: {trajectory: ground_truth}", AFTER_POSES),
        ("poses: {method: colmap}", AFTER_POSES),
        ("segments: {segmenter: classical, min_frames: 4}", AFTER_SEGMENTS),
        ("instances: {resolution: 200}", AFTER_INSTANCES),
        ("view_features: {min_area: 0.001}", AFTER_VIEWS),
        ("features: {supervision: average}", AFTER_FEATURES),
        ("transient: {transient_penalty: 0.005}", AFTER_TRANSIENT),
        ("masks: {threshold: 0.5}", AFTER_SEGMENTS),  # the threshold of tracks, too
        ("splats: {iterations: 41}", AFTER_SPLATS),
        ("camera: {refine_poses: on}", AFTER_GAUSSIANS),
        ("splats: {masking: none}", AFTER_SPLATS),
        ("language: {method: trained, iterations: 10}", AFTER_LANGUAGE),
        ("query: {canonical: [object, thing]}", {*AFTER_QUERIES, "scene_page"}),
        ("metrics: {masks: classes}", AFTER_QUERIES),
        ("frames: {stride: 2}", AFTER_FRAMES),
        ("synthetic: {objects: 17}", {"synthetic", *AFTER_FRAMES}),
        ("poses: {trajectory: closed_loop}", set()),  # the default, written out
        ("data_root: {hoi4d: /nowhere}", set()),
        ("scenes: config/../config/scenes.tsv", set()),
        # Exactly what uses a model or a threshold that changed; missing files do not matter.
        ("models: {set: published}", AFTER_SEGMENTS | AFTER_TRANSIENT),
        # Keys of the user win; SAM2's filters and the keys of queries follow the set.
        (SMALL_AGAIN, AFTER_SEGMENTS),
        (
            SMALL_AGAIN.replace("clip_model: small, clip_checkpoint: small", "cache: elsewhere"),
            AFTER_SEGMENTS,
        ),
    ],
)
def test_a_changed_key_reruns_its_stage_and_what_follows(unchanged, config, expected):
    assert unchanged.stale(*unchanged.MAIN, config=config) == expected


@pytest.mark.parametrize("method, instances", [("field", False), ("lifted", True)])
def test_a_run_of_everything_makes_instances_only_for_codes_that_are_learnt_from_them(
    unchanged, method, instances
):
    """Scenes behave as variants: a method that learns from tiles needs no segments, instances and features."""
    planned = unchanged.stale("all", config=f"{{splats: {{masking: none}}, language: {{method: {method}}}}}")
    assert {"metrics", "queries_sheet", "story"} <= planned and ("tiles" in planned) != instances
    of_instances = {*AFTER_SEGMENTS} - {"masks", "transient_sheet", *AFTER_SPLATS} | {"scene_page"}
    assert planned & of_instances == (of_instances if instances else set())


CODE = ("\ndef ", "\nCHANGED = 1\n\n\ndef ")
"""An edit of a module: a constant before its first function."""

PAGES = {
    "report/sheets/queries_sheet.py": CODE,
    "report/sheets/splats_sheet.py": ("PICTURES, CELL, CORRECTIONS = 4", "PICTURES, CELL, CORRECTIONS = 3"),
    "report/sheets/contact_sheet.py": ("PICTURES, COLUMNS = 8", "PICTURES, COLUMNS = 6"),
    "viewing/source/main.js": ("const FLUENT = 60", "const FLUENT = 50"),
}


@pytest.mark.parametrize(
    "edits, expected",
    [
        (PAGES, {"queries_sheet", "splats_sheet", "contact_sheet", "scene_page"}),
        ({"evaluation/scores.py": CODE}, AFTER_QUERIES),
        ({"query/maps.py": CODE}, {*AFTER_QUERIES, "contact_sheet", "scene_page", "transient_sheet"}),
        ({"language/lifting.py": CODE}, AFTER_LANGUAGE),
        ({"splats/stage.py": CODE}, AFTER_SPLATS),
        ({"transient/masks_stage.py": CODE}, AFTER_MASKS),
        ({"transient/network.py": CODE}, AFTER_TRANSIENT),
        ({"gaussians/trainer.py": ("RECORD_EVERY = 10", "RECORD_EVERY = 20")}, AFTER_GAUSSIANS),
        (
            {"rasterize/kernels/source/composite_backward.h": ("MOMENTS = 6;", "MOMENTS = 7;")},
            AFTER_GAUSSIANS,
        ),
        ({"features/aggregation.py": ("\nNORMS = (", "\nCHANGED = 1\nNORMS = (")}, AFTER_FEATURES),
        ({"features/crops.py": CODE}, AFTER_VIEWS),
        ({"instances/merging.py": ("FRAMES_A_BLOCK = 8", "FRAMES_A_BLOCK = 4")}, AFTER_INSTANCES),
        ({"segments/video.py": ("MIN_COMMON_FRAMES = 2", "MIN_COMMON_FRAMES = 3")}, AFTER_SEGMENTS),
        ({"poses/adt.py": CODE}, AFTER_POSES),
        ({"frames/selection.py": CODE}, AFTER_FRAMES),
        ({"frames/adt_annotations.py": CODE}, {"annotations", "contact_sheet", *AFTER_QUERIES}),
        ({"../egosplat_apartments/objects/textures.py": CODE}, {"synthetic", *AFTER_FRAMES}),
    ],
)
def test_edited_code_reruns_the_stages_that_execute_it(unchanged, edits, expected):
    with ExitStack() as edited:
        for module, (old, new) in edits.items():
            edited.enter_context(unchanged.edited(module, old, new))
        assert unchanged.stale(*unchanged.MAIN) == expected


# Edits that show in no result, or that another format or method alone executes.
WITHOUT_EFFECT = (
    ("rasterize/kernels/source/composite.h", "// Compositing of", "// The compositing of"),
    ("poses/colmap.py", "\ndef colmap_poses", "\n# why\ndef colmap_poses"),
    ("poses/adt.py", '"""', '"""New words. '),
    ("progress.py", "_SECONDS_BETWEEN_LINES = 10.0", "_SECONDS_BETWEEN_LINES = 5.0"),
    # Words of errors, log lines and progress.
    ("geometry.py", "a time lies outside the trajectory", "a time is outside of the trajectory"),
    ("files.py", "give another --output", "name another --output"),
    ("segments/tracker.py", "tracking resumes after", "tracking goes on after"),
    ("gaussians/trainer.py", "training resumes after iteration", "training goes on after iteration"),
    ("instances/lifted_masks.py", "lifting masks", "placing masks"),
    # Of formats, sources of poses and methods that the scene does not use.
    ("poses/colmap.py", *CODE),
    ("frames/pictures.py", "FOCAL_PRIOR = 1.2", "FOCAL_PRIOR = 1.3"),
    ("frames/hoi4d.py", "_MAX_LABEL = 6", "_MAX_LABEL = 7"),
    ("egosplat_rivals/lerf.py", "LARGEST_SCALE = 1.5", "LARGEST_SCALE = 1.6"),
    ("language/joint.py", "\nMETHOD = ", "\nCHANGED = 1\nMETHOD = "),
)


def test_edits_without_effect_rerun_nothing(workdir):
    for module, old, new in WITHOUT_EFFECT:
        workdir.edit(module, old, new)
    assert workdir.stale(*workdir.MAIN) == set()


@pytest.mark.slow
def test_an_edited_template_reruns_its_page(workdir):
    story = "results/adt/scene1/story.html"
    workdir.run(story)
    assert workdir.stale(story) == set()
    workdir.edit("report/story.html.j2", "<nav>", "<nav >")
    assert workdir.stale(story, *workdir.MAIN) == {"story"}


def overwrite(file: Path, image: Image.Image) -> None:
    """Write another picture in place, which changes the time of the file, but not of its folder."""
    folder = file.parent.stat().st_mtime_ns
    image.save(file)
    assert file.parent.stat().st_mtime_ns == folder


def test_the_bytes_of_a_recording_rerun_frames_and_no_time_does(one_scene, tmp_path):
    (pictures := tmp_path / "pictures").mkdir()
    for number in range(4):
        Image.new("RGB", (64, 48), (40 * number, 90, 0)).save(pictures / f"{number}.png")
    camera = dict.fromkeys(("fx", "fy"), 60.0) | {"width": 64, "height": 48, "cx": 32.0, "cy": 24.0}
    (pictures / "camera.json").write_text(json.dumps(camera))
    workdir, frames = one_scene("plain", pictures), "results/mine/scene/frames.zarr"
    assert workdir.run(frames).count("egosplat: mine/scene: the set photos knows") == 1
    (pictures / "notes.txt").touch()
    (pictures / "2.png").touch()
    assert workdir.stale(frames) == set()
    (older := tmp_path / "camera.json").write_text(json.dumps(camera | {"fx": 61.0}))
    os.utime(older, (0, 0))
    original = (pictures / "camera.json").rename(tmp_path / "original.json")
    older.rename(pictures / "camera.json")
    assert workdir.stale(frames) == {"frames"}
    original.rename(pictures / "camera.json")
    assert workdir.stale(frames) == set()
    overwrite(pictures / "2.png", Image.new("RGB", (64, 48), (41 * 2, 90, 0)))
    assert workdir.stale(frames) == {"frames"}


def test_files_of_a_hoi4d_sequence_rerun_the_stages_that_read_them(one_scene, tmp_path):
    """A mask in 2Dseg reruns annotations alone; intrinsics, which lie outside of the sequence, rerun frames."""
    sequence = tmp_path / "ZY20210800001/H1/C11/N58/S376/s02/T2"
    intrinsics = tmp_path / "camera_params/ZY20210800001/intrin.npy"
    write_video(sequence / "align_rgb/image.mp4", grey_frames(12))
    intrinsics.parent.mkdir(parents=True)
    np.save(intrinsics, np.array([[50.0, 0, 31.5], [0, 50, 23.5], [0, 0, 1]]))
    (masks := sequence / "2Dseg/mask").mkdir(parents=True)
    for number in range(12):
        Image.new("RGB", (64, 48), (128, 0, 0)).save(masks / f"{number:05d}.png")
    workdir = one_scene("hoi4d", sequence, "frames.resolution=32 frames.evaluation_frames=3")
    annotations = "results/mine/scene/annotations.zarr"
    workdir.run(annotations)
    assert workdir.stale(annotations) == set()
    overwrite(masks / "00000.png", Image.new("RGB", (64, 48), (0, 128, 0)))
    assert workdir.stale(annotations) == {"annotations"}
    np.save(intrinsics, np.array([[51.0, 0, 31.5], [0, 51, 23.5], [0, 0, 1]]))
    assert workdir.stale(annotations) == {"frames", "annotations"}


def test_another_checkpoint_reruns_the_stages_that_load_it(workdir):
    models = workdir.own_code() / "egosplat/models"
    for model, expected in (
        ("small_open_clip/open_clip_config.json", AFTER_VIEWS),
        ("small_open_clip/open_clip_model.safetensors", AFTER_VIEWS),
        ("small_sam2/model.safetensors", AFTER_SEGMENTS),
    ):
        before = (models / model).read_bytes()
        (models / model).write_bytes(before + b" ")
        assert workdir.stale(*workdir.MAIN) == expected
        (models / model).write_bytes(before)


@pytest.mark.slow
def test_other_encoder_weights_rerun_transient(workdir):
    weights = workdir.folder / "encoder.safetensors"
    encoder = make_network(64, False, None, 0).encoder
    save_file({name: value.contiguous() for name, value in encoder.state_dict().items()}, weights)
    (workdir.folder / "mine.yaml").write_text("transient: {encoder_weights: encoder.safetensors}")
    done = workdir.snakemake("mine.yaml", "--", "results/adt/scene1/transient.zarr")
    assert done.returncode == 0, done.stdout + done.stderr
    config = (workdir.folder / "mine.yaml").read_text()
    assert workdir.stale("results/adt/scene1/transient.zarr", config=config) == set()
    assert workdir.stale(*workdir.MAIN, config=config) == AFTER_MASKS

    with weights.open("ab") as file:
        file.write(b" ")
    assert workdir.stale(*workdir.MAIN, config=config) == AFTER_TRANSIENT


def test_after_an_edit_only_that_stage_runs_and_then_nothing(workdir):
    workdir.edit("poses/adt.py", *CODE)
    output = workdir.run(POSES)
    assert set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", output, re.MULTILINE)) == {"poses"}
    assert workdir.stale(POSES) == set()


def test_touched_sources_another_checkout_and_a_new_room_rerun_nothing_and_a_lost_artifact_itself(workdir):
    for file in workdir.own_code().rglob("*.py"):
        file.touch()
    (workdir.folder / "config/config.yaml").touch()
    (workdir.own_code() / "egosplat/another").mkdir()
    (workdir.own_code() / "egosplat/another/__init__.py").write_text("# a comment\n")
    assert workdir.stale(*workdir.MAIN) == set()
    shutil.rmtree(workdir.folder / POSES)
    assert workdir.stale(POSES) == {"poses"}
