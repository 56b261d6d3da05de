"""Drawn textures: paintings, book covers, clock faces, labels, keys, the view of a street."""

import colorsys

import cv2
import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.textures import Color, Picture, mixed, noise, shaded

_WORDS = (
    "MOON RIVER NIGHT GARDEN ATLAS WINTER HARBOUR SILENCE ISLAND PHYSICS COOKING LETTERS FOREST "
    "THE SEA HISTORY STONES BIRDS MUSIC CITY GEOMETRY TRAVELS LIGHT TEA OPTICS SALT NORTH"
)


def random_color(
    rng: Rng, saturation: tuple[float, float] = (0.4, 0.9), value: tuple[float, float] = (0.35, 0.9)
) -> Color:
    """A color of any hue, its saturation and value within the given ranges."""
    return colorsys.hsv_to_rgb(rng.uniform(0, 1), rng.uniform(*saturation), rng.uniform(*value))


def landscape(rng: Rng, shape: tuple[int, int]) -> Picture:
    """Sky with a sun, rows of hills, trees and flowers in front."""
    height, width = shape
    sky = [random_color(rng, (0.3, 0.6), (0.6, 1.0)) for _ in range(2)]
    rows = np.broadcast_to(np.linspace(0, 1, height)[:, None], shape)
    picture = np.ascontiguousarray(shaded(mixed(sky[0], sky[1], rows), 0.07 * noise(rng, shape, 1.6, 3.0)))
    sun = (int(rng.uniform(0.15, 0.85) * width), int(rng.uniform(0.12, 0.35) * height))
    cv2.circle(picture, sun, height // 11, (1.0, 0.92, 0.6), -1, cv2.LINE_AA)
    for layer in range(4):
        tint = random_color(rng, (0.35, 0.8), (0.25, 0.75))
        outline = noise(rng, (4, width), 1.5)[0] * height * 0.06 + height * (0.45 + 0.14 * layer)
        below = np.arange(height)[:, None] > outline[None]
        picture[below] = shaded(tint, 0.12 * noise(rng, shape, 1.0))[below]
        for x in rng.integers(0, width, 7 * (layer > 0)):
            _tree(rng, picture, int(x), int(outline[x]), height // (22 - 4 * layer))
    return picture


def abstract(rng: Rng, shape: tuple[int, int]) -> Picture:
    """Overlapping rectangles, discs and strokes on canvas."""
    height, width = shape
    picture = shaded(random_color(rng, (0.1, 0.4), (0.7, 0.95)), 0.04 * noise(rng, shape, 1.0))
    for _ in range(26):
        tint = random_color(rng, (0.2, 0.95), (0.1, 0.95))
        a, b = (tuple(int(v) for v in rng.integers(0, (width, height))) for _ in range(2))
        match int(rng.integers(3)):
            case 0:
                cv2.rectangle(picture, a, (a[0] + width // 5, a[1] + height // 6), tint, -1)
            case 1:
                cv2.circle(picture, a, int(rng.integers(4, height // 6)), tint, -1, cv2.LINE_AA)
            case _:
                cv2.line(picture, a, b, tint, int(rng.integers(2, 9)), cv2.LINE_AA)
    return shaded(picture, 0.06 * noise(rng, shape, 0.6))


def clock_face(rng: Rng, ground: Color, ink: Color, side: int = 256) -> Picture:
    """Ticks, numerals and two hands; fills the circle inscribed in the square."""
    picture = shaded(ground, 0.03 * noise(rng, (side, side), 1.0))
    middle = side // 2
    for hour in range(1, 13):
        way = np.array([np.sin(hour * np.pi / 6), -np.cos(hour * np.pi / 6)])
        begin, end = (tuple((middle + way * middle * r).astype(int).tolist()) for r in (0.82, 0.95))
        cv2.line(picture, begin, end, ink, 5, cv2.LINE_AA)
        x, y = (middle + way * middle * 0.65).astype(int).tolist()
        _write(picture, str(hour), (x - 9 - 7 * (hour > 9), y + 10), 0.8, ink)
    for angle, length, width in ((rng.uniform(0, 6.28), 0.45, 9), (rng.uniform(0, 6.28), 0.72, 5)):
        tip = (middle + middle * length * np.array([np.sin(angle), -np.cos(angle)])).astype(int).tolist()
        cv2.line(picture, (middle, middle), tuple(tip), ink, width, cv2.LINE_AA)
    cv2.circle(picture, (middle, middle), 9, ink, -1, cv2.LINE_AA)
    return picture


def cover(rng: Rng, color: Color, shape: tuple[int, int] = (256, 192)) -> Picture:
    """A book's cover: a picture, a title, an author."""
    height, width = shape
    picture = shaded(color, 0.05 * noise(rng, shape, 1.0))
    inset = abstract(rng, (height // 2, int(width * 0.8)))
    top, left = int(height * 0.36), int(width * 0.1)
    picture[top : top + inset.shape[0], left : left + inset.shape[1]] = inset
    ink = _ink(color)
    for row, scale in ((0.14, 1.0), (0.27, 1.0), (0.94, 0.55)):
        _word(rng, picture, (int(width * 0.08), int(height * row)), scale, ink)
    return picture


def spine(rng: Rng, color: Color, shape: tuple[int, int] = (64, 256)) -> Picture:
    """A book's back, its title along x, with bands at both ends."""
    height, width = shape
    picture = shaded(color, 0.07 * noise(rng, shape, 1.0))
    ink = _ink(color)
    for x in (int(width * 0.06), int(width * 0.92)):
        picture[:, x : x + 6] = ink
    _word(rng, picture, (int(width * 0.14), int(height * 0.68)), 1.0, ink)
    return picture


def label(rng: Rng, ground: Color, paper: Color) -> Picture:
    """A glazed jacket with a printed label, to be bent around a bottle or a box."""
    picture = shaded(ground, 0.07 * noise(rng, (256, 256), 1.2))
    picture[70:200] = shaded(paper, 0.03 * noise(rng, (130, 256), 1.0))
    ink = _ink(paper)
    for x in (8, 136):
        _word(rng, picture, (x, 115), 0.8, ink)
        cv2.circle(picture, (x + 50, 155), 22, random_color(rng), -1, cv2.LINE_AA)
        cv2.rectangle(picture, (x, 186), (x + 100, 192), ink, -1)
    return picture


def keys(rng: Rng, ground: Color, ink: Color, rows: int = 5, columns: int = 13) -> Picture:
    """A keyboard; with few rows and columns, a remote control's buttons."""
    picture = shaded(ground, 0.03 * noise(rng, (256, 256), 1.0))
    dy, dx = 256 // (rows + 1), 256 // (columns + 1)
    for row in range(rows):
        for column in range(columns):
            x, y = int((column + 0.7) * dx), int((row + 0.7) * dy)
            cv2.rectangle(picture, (x, y), (x + int(dx * 0.75), y + int(dy * 0.7)), ink, -1)
    return picture


def outside(rng: Rng, shape: tuple[int, int] = (256, 384)) -> Picture:
    """The view through a window: a bright sky, houses, trees."""
    height, width = shape
    rows = np.broadcast_to(np.linspace(0, 1, height)[:, None], shape)
    clouds = np.clip(0.5 + 0.3 * noise(rng, shape, 1.7, 2.0), 0, 1)
    picture = np.ascontiguousarray(mixed((0.55, 0.75, 0.98), (0.93, 0.96, 1.0), np.maximum(rows, clouds)))
    for _ in range(8):
        x, top = int(rng.integers(width)), int(rng.uniform(0.4, 0.65) * height)
        breadth = int(rng.integers(width // 12, width // 6))
        tint = random_color(rng, (0.1, 0.5), (0.55, 0.85))
        cv2.rectangle(picture, (x, top), (x + breadth, height), tint, -1)
        for y in range(top + 8, height, 18):
            for column in range(x + 5, x + breadth - 6, 14):
                cv2.rectangle(picture, (column, y), (column + 6, y + 9), (0.25, 0.3, 0.4), -1)
    for x in rng.integers(0, width, 9):
        _tree(rng, picture, int(x), int(rng.uniform(0.85, 1.0) * height), height // 9)
    return picture


def _tree(rng: Rng, picture: Picture, x: int, y: int, size: int) -> None:
    tint = np.array([0.15, 0.4, 0.15]) * rng.uniform(0.6, 1.5, 3)
    cv2.line(picture, (x, y), (x, y - 2 * size), (0.3, 0.2, 0.12), max(1, size // 4), cv2.LINE_AA)
    for _ in range(6):
        dx, dy = (rng.normal(0, 0.5, 2) * size).astype(int).tolist()
        shade = (tint * rng.uniform(0.7, 1.3)).tolist()
        cv2.circle(picture, (x + dx, y - 2 * size + dy), max(1, int(size * 0.6)), shade, -1, cv2.LINE_AA)


def _word(rng: Rng, picture: Picture, place: tuple[int, int], scale: float, ink: Color) -> None:
    _write(picture, str(rng.choice(_WORDS.split())), place, scale, ink)


def _write(picture: Picture, text: str, place: tuple[int, int], scale: float, ink: Color) -> None:
    """Draw letters with the lower left corner at ``place``, through a mask: OpenCV draws on bytes only."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(mask, text, place, cv2.FONT_HERSHEY_DUPLEX, scale, 255, 2, cv2.LINE_AA)
    share = mask[..., None] / 255.0
    picture[:] = picture * (1 - share) + np.asarray(ink) * share


def _ink(ground: Color) -> Color:
    return (0.95, 0.9, 0.75) if sum(ground) < 1.5 else (0.1, 0.08, 0.12)
