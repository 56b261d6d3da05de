"""The formats of ``egosplat export``: what each needs, and where it is written. Imports nothing heavy."""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import check_new_folder, check_output
from egosplat.pipeline.home import ASKED, check_scene_folder
from egosplat.pipeline.stages import STAGES

_CAMERAS, _PAGE = ("frames", "poses", "splats"), STAGES["scene_page"].inputs

# The file or folder of each format in the scene's, and the artifacts that it needs.
FORMATS = {
    "ply": ("scene.ply", ("splats",)),
    "spz": ("scene.spz", ("splats",)),
    "instances": ("instances.ply", ("splats", "instances")),
    "carries": ("carries.csv", ASKED),
    "nerfstudio": ("nerfstudio", _CAMERAS),
    "colmap": ("colmap", _CAMERAS),
    "html": ("scene.html", _PAGE),
    "rrd": ("scene.rrd", _PAGE),
}


def check_export(
    folder: Path, output: Path | None, format: str | None, query: str | None, *, codes: bool, overwrite: bool
) -> tuple[str, Path]:
    """Decide the format and the output, and check that the scene holds what is written and that it may be written.

    Args:
        folder: folder of a scene or a variant.
        output: file or folder; None for a name in ``folder``.
        format: a key of ``FORMATS``; None for what the suffix of ``output`` says, ply without an output.
        overwrite: whether another file than that of the default name may be replaced.

    Raises:
        UserError: the scene lacks an artifact, or the output may not be written or has another suffix than the format.
    """
    format = format or ("ply" if output is None else _format_by_suffix(output))
    if query is not None and format not in ("ply", "spz", "rrd"):
        raise UserError(f"--query: goes with --format ply, spz or rrd, not {format}")
    name, needed = FORMATS[format]
    asked = ASKED if query is not None else ()
    coded = ("language",) if codes and format == "ply" else ()
    check_scene_folder(folder, dict.fromkeys((*needed, *asked, *coded)))
    if query is not None and format != "rrd":
        name = f"answer.{format}"
    output = output or folder / name
    if "." in name:
        check_output(output, name, overwrite=overwrite)
    else:
        check_new_folder(output)
    return format, output


def _format_by_suffix(output: Path) -> str:
    suffix = output.suffix.lower()
    for format, (name, _) in FORMATS.items():
        if suffix and suffix == Path(name).suffix:
            return format
    raise UserError(f"{output}: has no suffix of a format; give the format: {', '.join(FORMATS)}")
