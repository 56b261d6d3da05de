"""The files of ``splats.source``. The workflow imports this module, so it stays light."""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import expand_home

# nerfstudio writes this file beside a training's config.yml: from the world of the data to that of the Gaussians.
DATAPARSER = "dataparser_transforms.json"


def source_files(source: str) -> list[Path]:
    """The Gaussians of another program, and nerfstudio's transform beside them; UserError if there is no such file."""
    path = expand_home(source)
    if path.is_dir():
        raise UserError(
            f"splats.source: {path} is a folder; give a file in it, such as point_cloud/iteration_30000/point_cloud.ply"
        )
    if not path.is_file():
        raise UserError(f"splats.source: there is no file {path}. Give the path of a .ply or .spz file")
    beside = path.with_name(DATAPARSER)
    return [path, beside] if beside.is_file() else [path]
