"""The scene page: one HTML file with its styles, scripts, shaders and data, which are named arrays and facts packed as text."""

import base64
import gzip
import json
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

import egosplat
from egosplat.artifacts.reader import Artifact
from egosplat.pipeline.home import OWN_FITS
from egosplat.query.options import HELD
from egosplat.viewing.options import ScenePageOptions

Arrays = dict[str, np.ndarray]
Facts = dict[str, Any]

# Scripts of the page, in the order of their definitions.
SCRIPTS = "container scene text answer carried camera cameras renderer picking controls main"

# The kinds of numbers that the page reads.
DTYPES = {"uint8", "int8", "uint16", "float16", "float32"}


def pack(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    """Pack facts and arrays for ``source/container.js``: gzip in base64, which holds no character that HTML would read as markup.

    Behind the length of the header (uint32) and the header (JSON: facts, and dtype and shape of each array) lie the arrays in order. The
    first bytes of all numbers come before the second bytes: equal bytes in a row compress better."""
    assert {values.dtype.name for values in arrays.values()} <= DTYPES
    described = {name: {"dtype": values.dtype.name, "shape": values.shape} for name, values in arrays.items()}
    header = json.dumps({"facts": facts, "arrays": described}, allow_nan=False).encode()
    parts = [np.uint32(len(header)).tobytes(), header, *map(_planes, arrays.values())]
    # Without the time of compression: the same scene gives the same page.
    return base64.b64encode(gzip.compress(b"".join(parts), 9, mtime=0)).decode()


def facts_of(page: str) -> Facts:
    """The facts that ``pack`` put into a page; none of what is no page, or a damaged one."""
    with suppress(EOFError, OSError, ValueError, zlib.error):
        raw = gzip.decompress(base64.b64decode(data_of(page)))
        return json.loads(raw[4 : 4 + int.from_bytes(raw[:4], "little")])["facts"]
    return {}


def _planes(values: np.ndarray) -> bytes:
    little = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False)
    return little.reshape(-1).view(np.uint8).reshape(-1, values.dtype.itemsize).T.tobytes()


def scene_html(title: str, data: str) -> str:
    """Build the page from any title, and the data of ``pack``."""
    scripts = "\n".join(page_source(f"{name}.js") for name in SCRIPTS.split())
    parts = {
        "title": escape(title),
        "generator": "egosplat page",
        "style": page_source("page.css"),
        "vertex": page_source("splat.vert.glsl"),
        "fragment": page_source("splat.frag.glsl"),
        # Neighbors and the order of depths.
        "worker": page_source("worker.js"),
        # A scope of its own: nothing but ``egosplat`` becomes global.
        "script": f'"use strict";\n(() => {{\n{scripts}\n}})();',
        "data": data,
    }
    page = page_source("page.html")
    for name, text in parts.items():
        before, _, after = page.partition(f"<!--{{{name}}}-->")
        page = before + text + after
    return page


def data_of(page: str) -> str:
    """The text of ``pack`` in a page."""
    return page.partition('id="data">')[2].partition("</script>")[0]


def served_html(page: str, asking: str) -> str:
    """A page that may ask the server it comes from, at an address that a phrase is appended to."""
    page = page.replace("default-src 'none';", "default-src 'none'; connect-src 'self';", 1)
    return page.replace('<html lang="en">', f'<html lang="en" data-asking="{escape(asking)}">', 1)


def record_of(artifacts: Iterable[Artifact], options: ScenePageOptions, folder: Path | None) -> Facts:
    """The version, the artifacts' digests, the options and a folder's own fit: pages with equal records show and answer the same."""
    values = options.as_dict()
    # The other keys change no answer of a whole scene, or say which OpenCLIP, which features.zarr tells.
    kept = (*HELD, "present_share", "max_gaussians")
    return {
        "version": egosplat.__version__,
        "made_from": {artifact.path.name: artifact.digest for artifact in artifacts},
        "options": {name: values[name] for name in kept},
        "own_fit": own.read_text(errors="replace") if folder and (own := folder / OWN_FITS).is_file() else "",
    }


def page_source(name: str) -> str:
    """A file of the folder ``source``."""
    return (resources.files("egosplat.viewing") / "source" / name).read_text(encoding="utf-8")
