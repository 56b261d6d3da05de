"""Write the scene page of a finished scene."""

from pathlib import Path

from egosplat.pipeline.scene_folder import title_of
from egosplat.pipeline.stages import STAGES, run_stage
from egosplat.viewing.command import locate_for_page
from egosplat.viewing.options import ScenePageOptions


def write_page(folder: Path, output: Path, options: ScenePageOptions, title: str | None = None) -> None:
    """Write the scene page of a finished scene; its title is ``dataset/scene`` unless given.

    Raises:
        UserError: an artifact is missing, damaged or does not belong to the others.
    """
    stage = STAGES["scene_page"]
    paths = {path.stem: path for path in locate_for_page(folder)}
    run_stage(stage.name, options, **paths, output=output, title=title or title_of(folder))
