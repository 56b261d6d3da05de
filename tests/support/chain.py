"""Run the stages of a scene one after the other in this process, for few iterations."""

from pathlib import Path

from egosplat.features import options as of_features
from egosplat.features import stage as features
from egosplat.features import view_features_stage as view_features
from egosplat.frames import stage as frames
from egosplat.frames.options import FramesOptions
from egosplat.instances import stage as instances
from egosplat.instances.options import InstancesOptions
from egosplat.language import stage as language
from egosplat.language.options import LanguageOptions
from egosplat.pipeline.config import defaults, stage_values
from egosplat.poses import stage as poses
from egosplat.poses.options import PosesOptions
from egosplat.segments import stage as segments
from egosplat.segments.options import SegmentsOptions
from egosplat.splats import stage as splats
from egosplat.splats.options import SplatsOptions
from egosplat.survey import stage as survey
from egosplat.survey.options import SurveyOptions
from egosplat.transient import masks_stage as masks
from egosplat.transient import options as of_transient
from egosplat.transient import stage as transient


def run_all(folder: Path, recording: Path, unit: float = 1.0, *, format: str = "plain", config=None) -> None:
    """Run the stages of a scene, for few iterations."""
    config = config or defaults()

    def of(kind, section, **changes):
        short = {key: 3 for key in ("iterations",) if key in kind.model_fields}
        near = {"near_plane": 0.1 * unit} if "near_plane" in kind.model_fields else {}
        return kind(**stage_values(section, config) | short | near | changes)

    def at(*names):
        return [folder / f"{name}.zarr" for name in names]

    seen = {"survey_path": folder / "survey.json"}
    frames.run(recording, *at("frames"), of(FramesOptions, "frames"), format=format)
    poses.run(recording, *at("frames", "poses"), of(PosesOptions, "poses"))
    survey.run(*at("frames", "poses"), folder / "survey.json", of(SurveyOptions, "survey"))
    network = of(of_transient.TransientOptions, "transient", encoder_weights=None)
    transient.run(*at("frames", "poses", "transient"), network, **seen)
    segments.run(*at("frames", "segments"), of(SegmentsOptions, "segments", segmenter="classical"), **seen)
    found = at("frames", "poses", "segments", "instances")
    instances.run(*found, of(InstancesOptions, "instances"), **seen)
    view_features.run(
        *at("frames", "instances", "view_features"), of(of_features.ViewFeaturesOptions, "view_features")
    )
    features.run(*at("view_features", "features"), of(of_features.FeaturesOptions, "features"))
    masks.run(*at("frames", "transient", "instances", "masks"), of(of_transient.MasksOptions, "masks"))
    masked = seen | {"masks_path": folder / "masks.zarr"}
    splats.run(*at("frames", "poses", "splats"), of(SplatsOptions, "splats", masking="refined"), **masked)
    more = {f"{name}_path": folder / f"{name}.zarr" for name in ("instances", "features")}
    language.run(
        *at("frames", "poses", "splats", "language"), of(LanguageOptions, "language"), **masked, **more
    )
