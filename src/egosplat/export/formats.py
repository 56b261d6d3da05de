"""The formats of ``egosplat export``: what each needs, and where it is written. Imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import check_new_folder, check_output
from egosplat.pipeline.scene_folder import ASKED, check_scene_folder
from egosplat.pipeline.stages import STAGES

# The artifacts that each format needs: Gaussians, a point cloud, a table of carries, images with cameras, the scene page, all of these
# over time.
FORMATS = {
    "ply": ("splats",),
    "spz": ("splats",),
    "instances": ("splats", "instances"),
    "carries": ASKED,
    "nerfstudio": ("frames", "poses", "splats"),
    "colmap": ("frames", "poses", "splats"),
    "html": STAGES["scene_page"].inputs,
    "rrd": STAGES["scene_page"].inputs,
}

# Suffix of the file of each format; the others are folders.
_SUFFIXES = {
    "ply": ".ply",
    "spz": ".spz",
    "instances": ".ply",
    "carries": ".csv",
    "html": ".html",
    "rrd": ".rrd",
}

# Formats whose file has their name.
_NAMED = ("instances", "carries")

# Formats that can hold the answer to a query alone, and one that shows answers in the scene.
_OF_QUERIES = ("ply", "spz")
_WITH_ANSWERS = "rrd"


@dataclass(frozen=True)
class Exporting:
    """What to write.

    Attributes:
        format: a key of ``FORMATS``.
        query: words; only the Gaussians of the best answer are written, or, of rrd, answers to words between commas. None
            writes all Gaussians and no answer.
        codes: also write the codes and shares of language.zarr to a .ply file.
    """

    format: str
    output: Path
    query: str | None
    codes: bool


def plan_export(
    folder: Path, output: Path | None, *, format: str | None, query: str | None, codes: bool, overwrite: bool
) -> Exporting:
    """Decide what to write, and check that the scene holds it and that it may be written.

    Args:
        folder: folder of a scene or a variant.
        output: file or folder; None for a name in ``folder``.
        format: a key of ``FORMATS``; None for what the suffix of ``output`` says.
        overwrite: whether another file than that of the default name may be replaced.

    Raises:
        UserError: the scene lacks an artifact, or the output may not be written or has another suffix than the format.
    """
    format = format or format_of(output)
    if query is not None and format not in (*_OF_QUERIES, _WITH_ANSWERS):
        raise UserError(
            f"--query: goes with --format {', '.join(_OF_QUERIES)} or {_WITH_ANSWERS}, not {format}"
        )
    asked = ASKED if query is not None else ()
    coded = ("language",) if codes and format == "ply" else ()
    check_scene_folder(folder, dict.fromkeys((*FORMATS[format], *asked, *coded)))
    name = own_name(format, None if format == _WITH_ANSWERS else query)
    output = output or folder / name
    if format in _SUFFIXES:
        check_output(output, name, overwrite=overwrite)
    else:
        check_new_folder(output)
    return Exporting(format, output, query, codes)


def format_of(output: Path | None) -> str:
    """The format that the suffix of an output says, ply without an output; raises UserError if there is none."""
    if output is None:
        return "ply"
    found = next((format for format, suffix in _SUFFIXES.items() if suffix == output.suffix.lower()), None)
    if found is None:
        raise UserError(f"{output}: has no suffix of a format; give the format: {', '.join(FORMATS)}")
    return found


def own_name(format: str, query: str | None) -> str:
    """Name of the file or folder that the command writes by default."""
    scene = "scene" if format in _SUFFIXES and format not in _NAMED else format
    return ("answer" if query is not None else scene) + _SUFFIXES.get(format, "")
