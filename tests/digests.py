"""Run three small scenes, and compare each array and each answer with a committed list: ``python -m tests.digests``. A change of the
code's structure keeps them all; another change says which it moves. The list holds for one kind of processor, because sums in another
order round differently. ``--write`` makes it anew, ``--only NAME`` runs one scene. About ten CPU-minutes."""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zarr

from tests.support import ROOT

LISTS = Path(__file__).parent
PROGRAMS = Path(sys.executable).parent

# The folder's configuration, keys of the call, the scene or variant to make, and the words to ask for.
SMALL = {"synthetic": {"size": 256, "fps": 2.0}, "frames": {"resolution": 256}}
SCENES: dict[str, tuple[str, dict, str, tuple[str, ...]]] = {
    "test": (".test", {}, "results/adt/scene1", ("couch", "elephant")),
    "apartment": (
        "",
        SMALL | {"splats": {"iterations": 1000}},
        "results/adt/scene2",
        ("couch", "lamp", "elephant"),
    ),
    "busy": (
        "",
        {
            "synthetic": SMALL["synthetic"] | {"seconds": 24.0},
            "frames": SMALL["frames"],
            "splats": {"iterations": 600},
            "transient": {"iterations": 300},
        },
        "results/adt/busy1/variants/refined_masks",
        ("cup", "couch", "elephant"),
    ),
}


def processor() -> str:
    """Get the kind of processor that a list holds for, by its widest vectors."""
    found = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    vendor = "amd" if "AuthenticAMD" in found else "intel" if "GenuineIntel" in found else "other"
    return f"{vendor}_{'avx512' if 'avx512f' in found else 'avx2' if 'avx2' in found else 'generic'}"


def run_scene(folder: Path, settings: dict, results: str, words: tuple[str, ...]) -> dict[str, str]:
    """Make a scene in a folder, ask it, and get the digest of each array file's folder and each answer."""
    keys = [f"{name}={json.dumps(value)}" for name, value in settings.items()]
    environment = os.environ | {"PATH": f"{PROGRAMS}:{os.environ['PATH']}", "OMP_NUM_THREADS": "1"}

    def call(*words: str) -> bytes:
        return subprocess.run(words, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE).stdout

    config = ["--config", *keys] if keys else []
    call(
        "snakemake",
        "--cores",
        "2",
        "--snakefile",
        str(ROOT / "workflow/Snakefile"),
        f"{results}/metrics.json",
        *config,
    )
    found = dict(sorted(digests_below(folder / "results")))
    answer = call("egosplat", "query", results, *words, "--output", "query.png")
    found["query"] = hashlib.sha256(answer).hexdigest()[:16]
    found["query.png"] = hashlib.sha256((folder / "query.png").read_bytes()).hexdigest()[:16]
    return found


def digests_below(results: Path):
    """Yield the name and the digest of each array of each artifact, however it is stored, and of each recording."""
    for path in results.rglob("zarr.json"):
        array = zarr.open(path.parent, mode="r")
        if isinstance(array, zarr.Array):
            content = f"{array.dtype} {array.shape}".encode() + np.asarray(array[...]).tobytes()
            yield path.parent.relative_to(results).as_posix(), hashlib.sha256(content).hexdigest()[:16]
    for folder in results.glob("*/*/recording"):
        digest = hashlib.sha256()
        for file in sorted(path for path in folder.rglob("*") if path.is_file()):
            name = f"{file.relative_to(folder)}\0".encode()
            digest.update(name + hashlib.sha256(file.read_bytes()).digest())
        yield folder.relative_to(results).as_posix(), digest.hexdigest()[:16]


def make(name: str) -> dict[str, str]:
    """Run a scene in a new folder."""
    folder_of_config, settings, results, words = SCENES[name]
    with tempfile.TemporaryDirectory(prefix=f"digests_{name}_") as folder:
        shutil.copytree(ROOT / folder_of_config / "config", Path(folder, "config"))
        return run_scene(Path(folder), settings, results, words)


def main() -> None:
    """Print what differs, and end with 1 where something does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the list of this kind of processor anew")
    parser.add_argument("--only", choices=SCENES, action="append", help="run this scene alone")
    arguments = parser.parse_args()
    path = LISTS / f"digests_{processor()}.json"
    listed = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if not (listed or arguments.write):
        sys.exit(f"{path.name}: no list for this kind of processor; --write on an earlier commit makes one")
    faults = []
    for name in arguments.only or SCENES:
        found = make(name)
        if arguments.write:
            listed[name] = found
            path.write_text(json.dumps(listed, indent=1) + "\n", encoding="utf-8")
        known = listed.get(name, {})
        faults += [f"{name}: {key}" for key in {**known, **found} if known.get(key) != found.get(key)]
        print(f"{name}: {len(found)} digests", flush=True)
    sys.exit("\n".join(["differ:", *faults]) if faults else 0)


if __name__ == "__main__":
    main()
