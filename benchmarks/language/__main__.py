"""Ways to put codes on Gaussians: mean codes in closed form, trained at three levels at once, or one model for each level.

    snakemake --cores 2 results/adt/scene2/language.zarr
    python -m benchmarks.language results/adt/scene2 --iterations 100 > benchmarks/language/README.md

Takes the artifacts of scenes whose Gaussians were trained without codes. Measures processor time and memory of each way in a
process of its own, and the cosine between decoded rendered codes and the consistent features of the segments in held-out views.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import torch
from torch import Tensor

from benchmarks.common import command, markdown, output_of, scene_folders, time_call
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.provenance import peak_memory_mb
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES, FRAMES, INSTANCES, POSES, SPLATS, camera_poses
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.gaussians.training_views import open_masking
from egosplat.language.decoder import Decoder, decode, read_decoder
from egosplat.language.lifting import lift
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets, Targets
from egosplat.language.views import CodeViews, select_code_views
from egosplat.pipeline.home import title_of
from egosplat.progress import log
from egosplat.rasterize.view import render_codes
from egosplat_rivals.langsplat import PlainCodes
from egosplat_rivals.loop import train

CPU = torch.device("cpu")
MEANS, TOGETHER, APART = (
    "mean codes, in closed form",
    "trained, three levels at once",
    "trained, one level a model",
)
# Levels of a model, and number of models.
WAYS = {MEANS: (3, 1), TOGETHER: (3, 1), APART: (1, 3)}

COLUMNS = (
    "scene",
    "way",
    "levels a model",
    "models",
    "CPU time [s]",
    "peak memory [MB]",
    "cosine, held out, by level",
    "mean",
)


@dataclass(frozen=True)
class Scene:
    """Inputs from which a scene's codes are computed."""

    gaussians: Gaussians
    settings: RenderSettings
    decoder: Decoder
    views: CodeViews
    targets: CodeTargets
    instances: Artifact
    features: Artifact
    frames: Artifact
    poses: Artifact
    splats: Artifact


def read(folder: Path) -> Scene:
    """Open a scene's artifacts."""
    kinds = {"frames": FRAMES, "poses": POSES, "instances": INSTANCES, "features": FEATURES, "splats": SPLATS}
    found = {name: open_artifact(folder / f"{name}.zarr", schema) for name, schema in kinds.items()}
    splats = found["splats"]
    paths = {f"{name}_path": folder / f"{name}.zarr" for name in ("transient", "masks")}
    masking = open_masking(splats.provenance["options"]["masking"], found["frames"], paths)
    targets = CodeTargets(found["instances"], found["features"], CPU)
    given = read_gaussians(splats), read_render_settings(splats, "auto")
    views = select_code_views(found["frames"], found["poses"], splats, targets.of, masking, *given)
    return Scene(*given, read_decoder(found["features"]), views, targets, **found)


def of_level(targets: Callable[[int], Targets], level: int) -> Callable[[int], Targets]:
    """The targets of one level alone."""

    def found(frame: int) -> Targets:
        every = targets(frame)
        return Targets(every.codes[level : level + 1], every.known[level : level + 1])

    return found


def trained(scene: Scene, views: CodeViews, levels: int, iterations: int) -> Tensor:
    """Codes trained by gradients."""
    options = LanguageOptions(iterations=iterations)
    found = PlainCodes(views, (levels, scene.targets.channels), options, scene.targets.unit_norm)
    with TemporaryDirectory() as folder:
        train(found, len(views), iterations, options.seed, Checkpoint(Path(folder) / "x", "", 1e9))
    return found.code.detach()


def codes(scene: Scene, way: str, iterations: int) -> Tensor:
    """Codes by one of the ways of training."""
    levels = len(scene.targets.levels)
    if way == TOGETHER:
        return trained(scene, scene.views, levels, iterations)
    views = [replace(scene.views, targets=of_level(scene.targets.of, level)) for level in range(levels)]
    return torch.cat([trained(scene, own, 1, iterations) for own in views], dim=1)


def cosines(scene: Scene, code: Tensor, share: Tensor) -> list[float]:
    """Mean cosine of rendered and consistent features over pixels of held-out views, by level."""
    held_out = scene.frames.read("evaluation") & ~scene.frames.read("train") & scene.poses.read("registered")
    poses = camera_poses(scene.poses, scene.splats)
    features = torch.from_numpy(scene.features.read("consistent"))
    seen = torch.from_numpy(scene.features.read("views") > 0)
    found: list[list[Tensor]] = [[] for _ in range(code.shape[1])]
    for frame in np.flatnonzero(held_out):
        with torch.no_grad():
            view = view_of(scene.gaussians, scene.views.camera, poses[frame], scene.settings)
            rendered, _ = render_codes(view, code, share)
        labels = torch.from_numpy(scene.instances.row("labels", int(frame))).long()
        for level, cosine in enumerate(found):
            known = (labels[level] >= 0) & seen[labels[level]]
            wanted = torch.nn.functional.normalize(features[labels[level][known]], dim=-1)
            cosine.append((decode(rendered[level][known], scene.decoder) * wanted).sum(-1))
    return [float(torch.cat(one).mean()) for one in found]


def measure(folder: Path, way: str, iterations: int) -> dict[str, object]:
    """Measure one way in this process."""
    scene = read(folder)
    (code, share), seconds = time_call(lift, scene.views)
    if way != MEANS:
        code, seconds = time_call(codes, scene, way, iterations)
    return {"seconds": seconds, "peak_mb": peak_memory_mb(), "cosines": cosines(scene, code, share)}


def row(folder: Path, way: str, iterations: int) -> list[object]:
    """A row of the table, measured in a process of its own."""
    log(f"{folder}: {way}")
    output = output_of("benchmarks.language", folder.resolve(), "--iterations", iterations, "--way", way)
    found = json.loads(output.splitlines()[-1])
    by_level = " ".join(f"{one:.3f}" for one in found["cosines"])
    times = [f"{found['seconds']:.1f}", f"{found['peak_mb']:.0f}"]
    return [title_of(folder), way, *WAYS[way], *times, by_level, f"{np.mean(found['cosines']):.3f}"]


@command(__doc__)
@scene_folders
@click.option("--iterations", default=1000, show_default=True, help="Of each training.")
@click.option("--way", type=click.Choice(list(WAYS)), hidden=True)
def main(folders: tuple[Path, ...], iterations: int, way: str | None) -> None:
    """Print the table; with a way, one measurement as JSON."""
    if way is not None:
        click.echo(json.dumps(measure(folders[0], way, iterations)))
        return
    rows = [row(folder, name, iterations) for folder in folders for name in WAYS]
    click.echo(
        f"# Codes on Gaussians\n\n`python -m benchmarks.language`, {iterations:,} iterations where codes are trained.\n"
    )
    click.echo(markdown(COLUMNS, rows, words=2))


if __name__ == "__main__":
    main()
