"""Write a finished scene for other programs: ``egosplat export``. What is heavy is imported when it is needed."""

from pathlib import Path
from typing import TYPE_CHECKING

from egosplat.errors import UserError
from egosplat.files import check_new_folder, check_output
from egosplat.pipeline.home import ASKED, check_scene_folder
from egosplat.pipeline.stages import STAGES
from egosplat.query.options import AskingOptions

if TYPE_CHECKING:
    from egosplat.query.finished_scene import Scene

_CAMERAS, _PAGE = ("frames", "poses", "splats"), STAGES["scene_page"].inputs

# The file or folder of each format in the scene's, and the artifacts that it needs.
FORMATS = {
    "ply": ("scene.ply", ("splats",)),
    "spz": ("scene.spz", ("splats",)),
    "instances": ("instances.ply", ("poses", "splats", "instances")),
    "nerfstudio": ("nerfstudio", _CAMERAS),
    "colmap": ("colmap", _CAMERAS),
    "html": ("scene.html", _PAGE),
    "rrd": ("scene.rrd", _PAGE),
}


def export_scene(
    scene: "Scene | str | Path",
    path: str | Path | None = None,
    *,
    format: str | None = None,
    query: str | None = None,
    codes: bool = True,
    overwrite: bool = False,
    options: AskingOptions | None = None,
) -> None:
    """Write an open scene, or the folder of one or of a variant, for other programs, as ``egosplat export``.

    Its file or folder is ``path``, or by default a name in the scene's folder; ``format`` is one of ``FORMATS``, by default what the
    suffix says, or ply. ``query``: only the Gaussians of the best answer (ply, spz), or boxes of answers (rrd); ``codes``: also language
    codes (ply). UserError: an artifact is missing, damaged or of another scene; the query has no answer; or a file is at ``path``.

    ``egosplat.export_scene(scene, "couch.ply", query="couch")`` writes the couch alone."""
    folder, opened = (Path(scene), None) if isinstance(scene, str | Path) else (scene.folder, scene)
    where = f"{path}: has no suffix of a format" if format is None else f"format {format!r}: is unknown"
    format = format or ("ply" if path is None else Path(path).suffix[1:].lower())
    if format not in FORMATS:
        raise UserError(f"{where}; give the format: {', '.join(FORMATS)}")
    if query is not None and format not in ("ply", "spz", "rrd"):
        raise UserError(f"--query: goes with --format ply, spz or rrd, not {format}")
    name, needed = FORMATS[format]
    asked = ASKED if query is not None else ("language",) if codes and format == "ply" else ()
    check_scene_folder(folder, dict.fromkeys((*needed, *asked)))
    name = name if query is None or format == "rrd" else f"answer.{format}"
    output = folder / name if path is None else Path(path)
    if "." in name:
        check_output(output, name, overwrite=overwrite)
    else:
        check_new_folder(output)
    from egosplat.export import cameras, gaussians, rerun_recording
    from egosplat.query.finished_scene import open_scene
    from egosplat.viewing.command import write_page

    opened = opened if options is None else None
    options = options or (opened.options if opened else AskingOptions())
    if format in ("nerfstudio", "colmap"):
        cameras.export_cameras(folder, output, format)
    elif format == "instances":
        gaussians.export_instances(folder, output)
    elif format == "html":
        write_page(folder, output, options)
    elif format == "rrd":
        rerun_recording.export_rerun(opened or open_scene(folder, options), output, query)
    else:
        answer = (
            None if query is None else gaussians.answer_members(opened or open_scene(folder, options), query)
        )
        gaussians.export_gaussians(folder, output, answer, codes=codes and format == "ply")
