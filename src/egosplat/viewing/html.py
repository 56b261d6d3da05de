"""Assemble the scene page: one HTML file with its styles, scripts, shaders and data."""

from collections.abc import Iterable
from html import escape
from importlib import resources

import egosplat
from egosplat.artifacts.reader import Artifact
from egosplat.query.options import QueryOptions
from egosplat.viewing.container import Facts
from egosplat.viewing.options import ScenePageOptions

# Generator named in the page's metadata.
GENERATOR = "egosplat page"

# Scripts of the page, in the order of their definitions.
SCRIPTS = (
    "container",
    "scene",
    "text",
    "answer",
    "carried",
    "camera",
    "cameras",
    "renderer",
    "picking",
    "controls",
    "main",
)


def scene_html(title: str, data: str) -> str:
    """Build the page from any title, and the data of ``container.pack``."""
    scripts = "\n".join(_source(f"{name}.js") for name in SCRIPTS)
    parts = {
        "title": escape(title),
        "generator": GENERATOR,
        "style": _source("page.css"),
        "vertex": _source("splat.vert.glsl"),
        "fragment": _source("splat.frag.glsl"),
        # Neighbors and the order of depths.
        "worker": _source("worker.js"),
        # A scope of its own: nothing but ``egosplat`` becomes global.
        "script": f'"use strict";\n(() => {{\n{scripts}\n}})();',
        "data": data,
    }
    page = _source("page.html")
    for name, text in parts.items():
        before, mark, after = page.partition(f"<!--{{{name}}}-->")
        if not mark:
            raise ValueError(f"page.html lacks the mark of {name}")
        page = before + text + after
    return page


def data_of(page: str) -> str:
    """The text of ``container.pack`` in a page."""
    return page.partition('id="data">')[2].partition("</script>")[0]


def served_html(page: str, asking: str) -> str:
    """A page that may ask the server it comes from, at an address that a phrase is appended to."""
    page = page.replace("default-src 'none';", "default-src 'none'; connect-src 'self';", 1)
    return page.replace('<html lang="en">', f'<html lang="en" data-asking="{escape(asking)}">', 1)


def record_of(artifacts: Iterable[Artifact], options: ScenePageOptions) -> Facts:
    """The version, the artifacts' digests and the options: pages with equal records show and answer the same."""
    values = options.as_dict()
    # The other keys say where a page is computed, and which OpenCLIP, which features.zarr tells.
    kept = (*QueryOptions.model_fields, "max_gaussians")
    return {
        "version": egosplat.__version__,
        "made_from": {artifact.path.name: artifact.digest for artifact in artifacts},
        "options": {name: values[name] for name in kept},
    }


def _source(name: str) -> str:
    return (resources.files("egosplat.viewing") / "source" / name).read_text(encoding="utf-8")
