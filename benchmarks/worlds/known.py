"""How well the small OpenCLIP knows the things of a world: it names true masks, and no other stage has a part in it.

    python -m benchmarks.worlds.known adt/scene{1,2,3} adt/busy1 adt/foreign{1,2,3}

Reads nothing but the table of scenes. Each thing of 400 pixels or more is named by the nearest of all categories.
"""

from dataclasses import dataclass

import click
import numpy as np

from benchmarks.common import command, markdown
from egosplat.errors import UserError
from egosplat.features.crops import cut_crop, encode, find_regions, resize
from egosplat.frames.rectify import pinhole
from egosplat.geometry import CLOCKWISE
from egosplat.models.clip import OpenClip
from egosplat.models.open_clip_loader import load_open_clip
from egosplat.pipeline.config import Config, defaults
from egosplat.pipeline.scenes import find_scene, read_scenes
from egosplat.query.text import encode_phrases
from egosplat_apartments.camera.lens import pinhole_lens
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from egosplat_apartments.stage import make_renderer
from egosplat_apartments.world.world import camera_pose, make_world

SIDE, MOMENTS, LEAST_PIXELS = 384, 8, 400
CATEGORIES = sorted(set(CATEGORY_UIDS) - {"shelter", "person"})


@dataclass(frozen=True)
class Named:
    """Sightings of things in one scene, those with the right name, and the mean of the accuracies of each category."""

    sightings: int
    right: int
    by_category: float


def name_things(film: Config, clip: OpenClip) -> Named:
    """Name the things in some frames of the recording that the section ``synthetic`` describes."""
    world = make_world(**{key: film[key] for key in ("seed", "seconds", "objects", "motion", "world")})
    renderer = make_renderer(world, pinhole_lens(pinhole(SIDE, 460.0)))
    texts, rng = encode_phrases(clip, CATEGORIES).numpy(), np.random.default_rng(film["seed"])
    number = {one.instance_id: index for index, one in enumerate(world.instances)}
    owner = np.array([number[world.geometry.bodies[body].instance_id] for body in world.geometry.part_body])
    truth, found = [], []
    for moment in np.linspace(0, film["seconds"], MOMENTS + 2)[1:-1].tolist():
        picture = renderer.picture(camera_pose(world, moment) @ CLOCKWISE, world.body_poses(moment), 1.0, rng)
        labels = np.where(picture.faces >= 0, owner[world.geometry.face_part[picture.faces]], -1).astype(
            np.int32
        )
        regions = find_regions(labels[None], len(world.instances))
        for instance, area, box in zip(regions.instance, regions.area, regions.box, strict=True):
            category = world.instances[instance].category
            if category in CATEGORIES and area >= LEAST_PIXELS:
                wanted = clip.preprocessing
                crop = resize(
                    cut_crop(picture.rgb, labels, instance, box), wanted.image_size, wanted.interpolation
                )
                feature = encode(clip, crop[None].copy())[0]
                truth.append(category)
                found.append(CATEGORIES[int(np.argmax(texts @ feature))])
    right = np.array(truth) == np.array(found)
    means = [right[np.array(truth) == category].mean() for category in set(truth)]
    return Named(len(right), int(right.sum()), float(np.mean(means)))


@command(__doc__)
@click.argument("names", nargs=-1, required=True)
def main(names: tuple[str, ...]) -> None:
    """Print the table."""
    config = defaults()
    scenes, models = read_scenes(config), config["models"]
    clip = load_open_clip(models["clip_model"], models["clip_checkpoint"], "cpu", "float32")
    rows = []
    for name in names:
        scene = find_scene(scenes, *name.split("/", 1)) if "/" in name else None
        if scene is None or not scene.synthetic:
            raise UserError(f"{name}: is not the dataset and scene of a synthetic recording; give adt/scene1")
        named = name_things(scene.config["synthetic"], clip)
        share = f"{100 * named.right / named.sightings:.0f} %"
        rows.append([name, named.sightings, share, f"{100 * named.by_category:.0f} %"])
    click.echo(markdown(["scene", "sightings", "rightly named", "mean over categories"], rows))


if __name__ == "__main__":
    main()
