"""The value by which a stage chooses its module; see ``Stage.modules``."""

from egosplat.calibration.companions import OF_PICTURES, poses_source, present_known_poses
from egosplat.pipeline.config import Config
from egosplat.pipeline.scenes import Scene


def chosen_value(stage: str, scene: Scene, config: Config) -> str | None:
    """Get the value for a scene; None for a stage that chooses no module.

    Args:
        config: configuration of the scene or variant.
    """
    match stage:
        case "frames" | "annotations":
            return scene.format
        case "poses":
            known = config["frames"]["known_poses"]
            has_known = scene.format in OF_PICTURES and bool(present_known_poses(scene.recording, known))
            return poses_source(config["poses"]["method"], scene.format == "adt", has_known)
        case "language":
            return "joint" if config["splats"]["language"] == "joint" else config["language"]["method"]
    return None
