"""How Gaussians learn what they mean: lifted in closed form, trained at three levels at once, or one model a level.

Takes the artifacts of scene folders, with Gaussians that were trained without codes, and measures time and memory of
each way, each in a process of its own, and how near rendered and decoded codes are to the consistent features of the
true instances' segments in held-out views.

    snakemake --cores 2 results/adt/scene2/language.zarr
    python benchmarks/language.py results/adt/scene2 --iterations 100 > benchmarks/language.md
"""

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.codes.decoder import Decoder, decode, read_decoder
from egosplat.codes.rendering import Lens, lens_of, render_codes
from egosplat.codes.targets import CodeTargets, Targets
from egosplat.errors import UserError
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.pixel_weights import open_masking
from egosplat.language.lifting import lift
from egosplat.language.training import CodeOptions, CodeTraining
from egosplat.language.views import TaughtViews, taught_views
from egosplat.pipeline.config import defaults
from egosplat.progress import log

CPU = torch.device("cpu")
HEADER = (
    "| scene | way | levels a model | models | CPU time [s] | peak memory [MB] | cosine, held out, by level | mean |\n"
    "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |"
)


@dataclass(frozen=True)
class Scene:
    """What a scene's codes are made from."""

    gaussians: Gaussians
    lens: Lens
    decoder: Decoder
    views: TaughtViews
    targets: CodeTargets
    segments: Artifact
    features: Artifact
    frames: Artifact
    poses: Artifact


def read(folder: Path) -> Scene:
    """Open a scene's artifacts."""
    kinds = {"frames": FRAMES, "poses": POSES, "segments": SEGMENTS, "features": FEATURES, "splats": SPLATS}
    found = {name: open_artifact(folder / f"{name}.zarr", schema) for name, schema in kinds.items()}
    masking = open_masking(
        found["splats"].provenance["options"]["masking"],
        found["frames"],
        transient=folder / "transient.zarr",
        masks=folder / "masks.zarr",
    )
    targets = CodeTargets(found["segments"], found["features"], CPU)
    return Scene(
        read_gaussians(found["splats"]),
        lens_of(found["splats"], "auto"),
        read_decoder(found["features"]),
        taught_views(found["frames"], found["poses"], targets.of, masking, CPU),
        targets,
        found["segments"],
        found["features"],
        found["frames"],
        found["poses"],
    )


def of_level(targets: Callable[[int], Targets], level: int) -> Callable[[int], Targets]:
    """The targets of one level alone."""

    def found(frame: int) -> Targets:
        every = targets(frame)
        return Targets(every.codes[level : level + 1], every.known[level : level + 1])

    return found


def lifted(scene: Scene) -> tuple[Tensor, Tensor]:
    """Codes and shares by closed form."""
    found = lift(scene.gaussians, scene.views, scene.lens)
    return found.code, found.share


def trained(scene: Scene, views: TaughtViews, levels: int, iterations: int) -> Tensor:
    """Codes by gradients."""
    keys = defaults()["language"]
    options = CodeOptions(iterations, keys["lr"], keys["unit_codes"], keys["seed"])
    training = CodeTraining(scene.gaussians, levels, scene.targets.channels, options)
    with TemporaryDirectory() as folder:
        training.run(scene.gaussians, views, scene.lens, Checkpoint(Path(folder) / "x", "", 1e9))
    return training.code.detach()


def cosines(scene: Scene, code: Tensor, share: Tensor) -> list[float]:
    """By level, the mean cosine of rendered features with consistent ones over pixels of held-out views."""
    held_out = scene.frames.read("evaluation") & ~scene.frames.read("train") & scene.poses.read("registered")
    poses = scene.poses.read("camera_to_world")
    features = torch.from_numpy(scene.features.read("consistent"))
    seen = torch.from_numpy(scene.features.read("views") > 0)
    found: list[list[Tensor]] = [[] for _ in range(code.shape[1])]
    for frame in np.flatnonzero(held_out):
        with torch.no_grad():
            rendered = render_codes(
                scene.gaussians,
                code,
                share,
                scene.views.camera,
                poses[frame],
                near_plane=scene.lens.near_plane,
                antialiased=scene.lens.antialiased,
                backend=scene.lens.backend,
            )
        labels = torch.from_numpy(scene.segments.row("labels", int(frame))).long()
        for level, cosine in enumerate(found):
            known = (labels[level] >= 0) & seen[labels[level]]
            wanted = torch.nn.functional.normalize(features[labels[level][known]], dim=-1)
            cosine.append((decode(rendered.codes[level][known], scene.decoder) * wanted).sum(-1))
    return [float(torch.cat(one).mean()) for one in found]


def measure(folder: Path, way: str, iterations: int) -> dict[str, object]:
    """One row, in this process."""
    scene = read(folder)
    began = time.process_time()
    code, share = lifted(scene)
    if way == "trained, three levels at once":
        began = time.process_time()
        code = trained(scene, scene.views, len(scene.targets.levels), iterations)
    elif way == "trained, one level a model":
        began = time.process_time()
        parts = []
        for level in range(len(scene.targets.levels)):
            views = TaughtViews(**vars(scene.views) | {"targets": of_level(scene.targets.of, level)})
            parts.append(trained(scene, views, 1, iterations))
        code = torch.cat(parts, dim=1)
    seconds = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "peak_mb": peak, "cosines": cosines(scene, code, share)}


WAYS = {
    "lifted": (3, 1),
    "trained, three levels at once": (3, 1),
    "trained, one level a model": (1, 3),
}
"""Levels of a model, and models."""


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--iterations", default=1000, show_default=True, help="Of each training.")
@click.option("--way", type=click.Choice(list(WAYS)), hidden=True)
def main(folders: tuple[Path, ...], iterations: int, way: str | None) -> None:
    """Print the table; with a way, one measurement as JSON."""
    if way is not None:
        click.echo(json.dumps(measure(folders[0], way, iterations)))
        return
    click.echo(f"# What Gaussians mean: {iterations:,} iterations where trained\n\n{HEADER}")
    for folder in folders:
        for name, (levels, models) in WAYS.items():
            log(f"{folder}: {name}")
            command = [sys.executable, __file__, str(folder), "--iterations", str(iterations), "--way", name]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            found = json.loads(done.stdout.splitlines()[-1])
            by_level = " ".join(f"{one:.3f}" for one in found["cosines"])
            click.echo(
                f"| {folder.parent.name}/{folder.name} | {name} | {levels} | {models} | {found['seconds']:.1f} "
                f"| {found['peak_mb']:.0f} | {by_level} | {np.mean(found['cosines']):.3f} |"
            )


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"language.py: {error}")
