"""Inputs, flags and survey decisions of each stage, as functions of a configuration and a survey."""

import json
from collections.abc import Iterable

from egosplat.pipeline.chunks import split_frames
from egosplat.pipeline.config import Config, merge, stage_sections, stage_values
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.survey_file import Survey, digest_of, frames_of_gaussians

AUTO, ALL_FRAMES = "auto", "all"

# Keys of the section camera that the survey can decide; survey.json has its decisions under the same names.
CAMERA = ("refine_poses", "compensate_exposure")

# Artifacts with the masks, by splats.masking. The survey may choose any of the three; "masks" is the longest chain of stages.
_MASKS = {"none": (), "initial": ("transient",), "refined": ("masks",), AUTO: ("masks",)}


def leaves_frames_out(config: Config) -> bool:
    """Whether training follows the survey's list of frames."""
    return config["survey"]["min_view_change_deg"] > 0


def segments_single_frames(config: Config) -> bool:
    """Whether SAM2 segments each frame by itself."""
    keys = config["segments"]
    return keys["prompting"] == "each_frame" and keys["segmenter"] == "sam2"


def tracks_what_moves(config: Config) -> bool:
    """Whether SAM2 tracks what moves and nothing else. True also where the survey may still decide against it."""
    return segments_single_frames(config) and config["segments"]["track_moving"] != "never"


def merges_masks(config: Config) -> bool:
    """Whether masks are merged into instances; else each track, or mask of a frame, is one."""
    source = config["instances"]["source"]
    return segments_single_frames(config) if source == AUTO else source != "tracks"


def merges_on_splats(config: Config) -> bool:
    """Whether masks are merged on the scene's Gaussians: another program's, or those trained where nothing is tracked or masked."""
    # Elsewhere the Gaussians need the instances first, or show what moves in several places; temporary ones are trained.
    keys = config["splats"]
    still = segments_single_frames(config) and not tracks_what_moves(config) and keys["masking"] == "none"
    return merges_masks(config) and bool(keys["source"] or (still and keys["language"] == "after"))


def decided_by_survey(config: Config) -> set[tuple[str, str]]:
    """Get section and name of the keys whose value ``auto`` the survey replaces; no camera of given Gaussians is corrected."""
    keys = {("splats", "masking")}
    keys |= {("segments", "track_moving")} if tracks_what_moves(config) else set()
    keys |= set() if config["splats"]["source"] else {("camera", name) for name in CAMERA}
    return {(section, name) for section, name in keys if config[section][name] == AUTO}


def is_surveyed(config: Config) -> bool:
    """Whether the survey decides something."""
    return bool(decided_by_survey(config)) or leaves_frames_out(config)


def follows_survey(stage: str) -> bool:
    """Whether a stage has a key that the survey can decide."""
    return stage == "segments" or "camera" in stage_sections(stage)


def decide(config: Config, survey: Survey) -> Config:
    """Replace ``auto`` in a configuration by the survey's decisions."""
    masking = survey["motion"]["masking"]
    values = {"masking": masking, "track_moving": "always" if masking == "refined" else "never"}
    values |= {name: "on" if survey["camera"][name] else "off" for name in CAMERA}
    chosen: Config = {}
    for section, name in decided_by_survey(config):
        chosen.setdefault(section, {})[name] = values[name]
    return merge(config, chosen)


def inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """Get the stages whose artifacts a stage reads, and the survey if it decides which."""
    optional = optional_inputs_of(stage, config)
    names = tuple(name for name in STAGES[stage].inputs if name in STAGES) + optional
    # Snakemake must run the survey before it knows whether the stage needs masks, or what moves.
    sections = {section for section, _ in decided_by_survey(config)}
    waits_for = {"splats"} if "masks" in STAGES[stage].optional else set()
    waits_for |= {"camera"} if "camera" in stage_sections(stage) else set()
    waits_for |= {"segments"} if stage == "segments" or "histories" in optional else set()
    waits_for |= {"splats", "segments"} if stage == "instances" and merges_masks(config) else set()
    return names if "survey" in names or sections.isdisjoint(waits_for) else (*names, "survey")


def optional_inputs_of(stage: str, config: Config) -> tuple[str, ...]:
    """Get the optional inputs of a stage that a configuration needs."""
    views = ("survey",) if leaves_frames_out(config) else ()
    if stage == "segments":  # the same for every splats.masking, so that variants share the segments
        moving = ("transient",) if tracks_what_moves(config) else ()
        return (("poses",) if segments_single_frames(config) else ()) + views + moving
    if stage == "splats" and config["splats"]["source"]:
        return ()
    given = ("splats",) if stage == "instances" and merges_on_splats(config) else ()
    # Answers and pages tell where carried things were if what moves is tracked and Gaussians mean something.
    lifted = config["splats"]["language"] != "joint" and config["language"]["method"] == "lifted"
    tracked = ("histories",) if lifted and tracks_what_moves(config) else ()
    wanted = views + given + _MASKS[config["splats"]["masking"]] + tracked
    return tuple(name for name in wanted if name in STAGES[stage].optional) + learnt_from(stage, config)


def learnt_from(stage: str, config: Config) -> tuple[str, ...]:
    """Get the optional inputs of a stage that codes are learnt from. No survey decides them."""
    is_joint = config["splats"]["language"] == "joint"
    if stage == "splats" and not is_joint:
        return ()
    of_tiles = not is_joint and config["language"]["method"] in ("field", "quantized")
    wanted = ("tiles",) if of_tiles else ("instances", "features")
    return tuple(name for name in wanted if name in STAGES[stage].optional)


def stages_behind(stages: Iterable[str], config: Config) -> list[str]:
    """List stages and all that they are made from, in the order of the pipeline."""
    todo, found = list(stages), set()
    while todo:
        if (stage := todo.pop()) not in found:
            found.add(stage)
            todo += inputs_of(stage, config)
    return [stage for stage in STAGES if stage in found]


def training_frames(stage: str, config: Config, survey: Survey) -> str:
    """Get the digest of the frames, and of the cells, that a stage trains on, or ``ALL_FRAMES``. The rule reruns if it changes."""
    if not leaves_frames_out(config) or (stage == "splats" and config["splats"]["source"]):
        return ALL_FRAMES
    if stage != "splats":
        return survey["views"]["digest"]
    # In a static scene the Gaussians may train on all frames: another list of frames changes nothing.
    chosen = frames_of_gaussians(survey, decide(config, survey)["splats"]["masking"])
    frames = ALL_FRAMES if chosen is None else chosen[1]
    return f"{frames} {digest_of(survey['cells'])}" if survey["cells"] else frames


def count_chunks(stage: str, config: Config, survey: Survey) -> int:
    """Count the chunks of frames, or cells, on which jobs of a stage work; 0 if one job works on all."""
    if stage == "splats":
        return len(survey["cells"]) if "survey" in optional_inputs_of(stage, config) else 0
    needs_all = {
        "segments": not segments_single_frames(config),  # tracks go on from frame to frame
        "view_features": config["view_features"]["max_views"] is not None,  # chosen among all frames, and few
    }
    chunks = split_frames(survey["poses"]["frames"])
    return 0 if needs_all.get(stage) or len(chunks) == 1 else len(chunks)


def options_json(stage: str, config: Config) -> str:
    """Format the values of a stage's options as JSON, sorted by name, for its flag ``--options``."""
    return json.dumps(stage_values(stage, config), sort_keys=True)


def default_pages(config: Config) -> list[str]:
    """Get the files of a scene that a run without a target makes."""
    pages = ["contact_sheet", *_pages_of_codes(config), "metrics", "queries_sheet"]
    return [*(STAGES[name].output for name in pages), "story.html"]


def story_stages(config: Config, annotated: bool, surveyed: bool) -> list[str]:
    """Get the stages whose outputs a scene's story tells of; the configuration has the survey's decisions."""
    pages = _pages_of_codes(config)
    stages = [*stages_behind(["language", *pages], config), *pages]
    stages += ["annotations", "contact_sheet", "metrics", "queries_sheet"] if annotated else []
    return list(dict.fromkeys([*stages, "survey"] if surveyed else stages))


def _pages_of_codes(config: Config) -> list[str]:
    """Get the stages that draw what a scene's codes are made from."""
    of_instances = "instances" in learnt_from("language", config)
    pages = ["instances_sheet", "crops_sheet", "scene_page"] if of_instances else []
    # The survey may still decide against tracks, as against masks.
    is_tracked = tracks_what_moves(config) and config["segments"]["track_moving"] != AUTO
    carried = ["carries_sheet"] if pages and is_tracked else []
    moving = ["transient_sheet"] if config["splats"]["masking"] == "refined" else []
    return [*pages, *moving, *carried, "splats_sheet"]
