"""Fill a template of a page that is one self-contained HTML file, with pictures inside."""

import base64
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


def read_picture(path: Path) -> str:
    """Read a PNG or JPEG file as the data URI of a WebP (UserError: it cannot be read, or is of another kind)."""
    if path.suffix.lower() not in _KINDS:
        raise UserError(f"{path}: is not an image for the page; give {', '.join(_KINDS)}")
    if not path.is_file():
        raise UserError(f"{path}: does not exist. Make it: {make_command(path)}")
    try:
        image = read_rgb(path)
    except UserError as error:
        raise UserError(f"{error} Make it again: {make_command(path, flag='--force ')}") from error
    # Inside the page, so that it can be sent as one file.
    content = base64.b64encode(encode_webp(shrink_image(image, LARGEST), _QUALITY).tobytes()).decode("ascii")
    return f"data:image/webp;base64,{content}"


def render_page(package: str, template: str, **values: Any) -> str:
    """Fill a template of a package; every value is escaped that the template does not call safe."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = resources.files(package).joinpath(template).read_text(encoding="utf-8")
    return environment.from_string(text).render(**values)
