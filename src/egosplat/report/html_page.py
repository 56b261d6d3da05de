"""Fill a template of a page that is one self-contained HTML file, with pictures inside."""

import base64
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from egosplat.errors import UserError
from egosplat.frames.images import read_rgb
from egosplat.images import LARGEST, encode_webp, shrink_image
from egosplat.pipeline.home import make_command

_KINDS = (".png", ".jpg", ".jpeg")

# Quality of WebP on the page: a page of methods takes a sixth of its PNG, and its text stays sharp.
_QUALITY = 90


@dataclass(frozen=True)
class Picture:
    """An image on a page: its name, its caption, and its content as a data URI."""

    name: str
    address: str
    about: str


def read_picture(path: Path, about: str | None = None) -> Picture:
    """Read a PNG or JPEG file and encode it as WebP; its name, and without ``about`` its caption, is its path
    below ``results`` (UserError: it cannot be read, or is of another kind)."""
    if path.suffix.lower() not in _KINDS:
        raise UserError(f"{path}: is not an image for the page; give {', '.join(_KINDS)}")
    if not path.is_file():
        raise UserError(f"{path}: does not exist. Make it: {make_command(path)}")
    try:
        image = read_rgb(path)
    except UserError as error:
        raise UserError(f"{error} Delete it and make it again: {make_command(path)}") from error
    # Inside the page, so that it can be sent as one file.
    content = base64.b64encode(encode_webp(shrink_image(image, LARGEST), _QUALITY).tobytes()).decode("ascii")
    name = path.as_posix().rpartition("results/")[2]
    return Picture(name, f"data:image/webp;base64,{content}", name if about is None else about)


def render_page(package: str, template: str, **values: Any) -> str:
    """Fill a template of a package; every value is escaped that the template does not call safe."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = resources.files(package).joinpath(template).read_text(encoding="utf-8")
    return environment.from_string(text).render(**values)
