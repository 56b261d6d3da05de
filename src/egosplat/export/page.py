"""Write the scene page of a finished scene."""

from pathlib import Path

from egosplat.artifacts.locating import locate
from egosplat.pipeline.scene_folder import title_of
from egosplat.pipeline.stages import STAGES, run_stage
from egosplat.viewing.options import ScenePageOptions


def write_page(folder: Path, output: Path, options: ScenePageOptions, title: str | None = None) -> None:
    """Write the scene page of a finished scene; its title is ``dataset/scene`` unless given.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others.
    """
    stage = STAGES["scene_page"]
    paths = dict(zip(stage.inputs, locate(folder, *stage.inputs), strict=True))
    run_stage(stage.name, options, **paths, output=output, title=title or title_of(folder))
