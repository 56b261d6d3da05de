"""Tables, cabinets and shelves. Every builder returns an object in its own axes, front towards +z."""

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_metal, some_paint, some_plastic, some_wood
from egosplat_apartments.objects.model import Model, Surface, assemble
from egosplat_apartments.objects.pictures import landscape, random_color
from egosplat_apartments.objects.shapes import Part, Shape, at_corners, box, cylinder, join, lathe, rod
from egosplat_apartments.objects.textures import cloth, make_texture, marble, metal


def four_legs(width: float, depth: float, height: float, thickness: float, inset: float = 0.03) -> Shape:
    """Square legs under a rectangle centered on the origin."""
    half = thickness / 2

    def leg(x: float, z: float) -> Shape:
        return box((x - half, 0, z - half), (x + half, height, z + half))

    return at_corners(leg, width / 2 - inset - half, depth / 2 - inset - half)


def table(rng: Rng, width: float, depth: float, height: float) -> Model:
    """Top, apron and legs; the top is wood or marble."""
    stone = rng.random() < 0.3
    frame = some_wood(rng)
    if stone:
        top = make_texture(marble(rng, (0.85, 0.84, 0.8), (0.3, 0.3, 0.33)), 0.8, surface="marble")
    else:
        top = some_wood(rng)
    x, z = width / 2, depth / 2
    apron = box((-x + 0.06, height - 0.11, -z + 0.06), (x - 0.06, height - 0.04, z - 0.06))
    return assemble(
        Part("top", box((-x, height - 0.04, -z), (x, height, z)), top),
        Part("apron", apron, frame),
        Part("legs", four_legs(width, depth, height - 0.04, 0.06), frame),
        surfaces=(Surface("table", (-x + 0.04, -z + 0.04), (x - 0.04, z - 0.04), height),),
    )


def coffee_table(rng: Rng) -> Model:
    """A low table with a shelf below, or a round one on a pedestal."""
    if rng.random() < 0.35:
        radius, top, frame = rng.uniform(0.34, 0.42), some_wood(rng), some_metal(rng)
        pedestal = lathe([(0, 0), (0.24, 0), (0.24, 0.03), (0.05, 0.06), (0.05, 0.37), (0.16, 0.4), (0, 0.4)])
        side = radius * 0.7
        parts = (Part("top", cylinder(radius, 0.4, 0.44, 32), top), Part("pedestal", pedestal, frame))
        return Model(parts, (Surface("table", (-side, -side), (side, side), 0.44),))
    width, depth = rng.uniform(0.85, 1.1), rng.uniform(0.5, 0.6)
    low = table(rng, width, depth, 0.44)
    tray = box((-width / 2 + 0.1, 0.14, -depth / 2 + 0.1), (width / 2 - 0.1, 0.16, depth / 2 - 0.1))
    return assemble(*low.parts, Part("lower shelf", tray, low.parts[1].texture), surfaces=low.surfaces)


def dining_table(rng: Rng) -> Model:
    """A table for four to six."""
    return table(rng, rng.uniform(1.1, 1.4), rng.uniform(0.75, 0.85), 0.74)


def desk(rng: Rng) -> Model:
    """A writing table with a chest of drawers under its right end."""
    plain = table(rng, 1.15, 0.58, 0.74)
    fronts, knobs = _drawers(0.2, 0.52, 0.16, 0.6, 3, 0.25)
    chest = box((0.2, 0.14, -0.25), (0.52, 0.62, 0.25))
    paint = some_paint(rng)
    drawers = (
        Part("chest", chest, paint),
        Part("drawers", fronts, paint),
        Part("knobs", knobs, some_metal(rng)),
    )
    return assemble(*plain.parts, *drawers, surfaces=plain.surfaces)


def side_table(rng: Rng) -> Model:
    """A night stand: a small cabinet on legs with two drawers."""
    body, trim = some_paint(rng), some_wood(rng)
    fronts, knobs = _drawers(-0.19, 0.19, 0.18, 0.5, 2, 0.19)
    return assemble(
        Part("body", box((-0.21, 0.14, -0.19), (0.21, 0.52, 0.19)), body),
        Part("top", box((-0.23, 0.52, -0.2), (0.23, 0.55, 0.21)), trim),
        Part("drawers", fronts, trim),
        Part("knobs", knobs, some_metal(rng)),
        Part("legs", four_legs(0.42, 0.38, 0.14, 0.05), trim),
        surfaces=(Surface("table", (-0.21, -0.18), (0.21, 0.19), 0.55),),
    )


def cabinet(rng: Rng) -> Model:
    """A chest with drawers above and two doors below."""
    body, trim = some_paint(rng), some_wood(rng)
    w, d, h = rng.uniform(0.85, 1.05), 0.42, rng.uniform(0.8, 0.95)
    fronts, knobs = _drawers(-w / 2 + 0.02, w / 2 - 0.02, h * 0.66, h - 0.04, 1, d / 2, columns=2)
    doors, pulls = _drawers(-w / 2 + 0.02, w / 2 - 0.02, 0.1, h * 0.63, 1, d / 2, columns=2)
    return assemble(
        Part("body", box((-w / 2, 0.06, -d / 2), (w / 2, h - 0.03, d / 2)), body),
        Part("top", box((-w / 2 - 0.02, h - 0.03, -d / 2), (w / 2 + 0.02, h, d / 2 + 0.03)), trim),
        Part("drawers", fronts, some_paint(rng)),
        Part("doors", doors, trim),
        Part("knobs", join([knobs, pulls]), some_metal(rng)),
        Part("plinth", box((-w / 2 + 0.03, 0, -d / 2), (w / 2 - 0.03, 0.06, d / 2 - 0.03)), trim),
        surfaces=(Surface("table", (-w / 2, -d / 2 + 0.02), (w / 2, d / 2), h),),
    )


def _drawers(
    left: float, right: float, low: float, high: float, rows: int, front: float, columns: int = 1
) -> tuple[Shape, Shape]:
    """Fronts that protrude from the plane z = front, and a knob on each."""
    fronts, knobs = [], []
    dx, dy = (right - left) / columns, (high - low) / rows
    for x in (left + dx * number for number in range(columns)):
        for y in (low + dy * number for number in range(rows)):
            fronts.append(box((x + 0.01, y + 0.01, front), (x + dx - 0.01, y + dy - 0.01, front + 0.018)))
            center = (x + dx / 2, y + dy / 2)
            knobs.append(rod((*center, front + 0.018), (*center, front + 0.045), 0.014))
    return join(fronts), join(knobs)


def tv_stand(rng: Rng) -> Model:
    """A long low board with doors at both ends and an open bay between."""
    body, door = some_wood(rng), some_paint(rng)
    w, d, h = rng.uniform(1.3, 1.6), 0.4, 0.46
    walls = [(x - 0.012, x + 0.012) for x in (-w / 2 + 0.012, -w / 6, w / 6, w / 2 - 0.012)]
    shell = [box((a, 0.1, -d / 2), (b, h - 0.03, d / 2)) for a, b in walls]
    shell += [
        box((-w / 2, 0.08, -d / 2), (w / 2, 0.1, d / 2)),
        box((-w / 2, 0.1, -d / 2), (w / 2, h - 0.03, -d / 2 + 0.012)),
    ]
    doors = [_drawers(a, b, 0.11, h - 0.04, 1, d / 2) for a, b in ((-w / 2, -w / 6), (w / 6, w / 2))]
    top = box((-w / 2 - 0.01, h - 0.03, -d / 2), (w / 2 + 0.01, h, d / 2 + 0.02))
    return assemble(
        Part("body", join(shell), body),
        Part("top", top, body),
        Part("doors", join([fronts for fronts, _ in doors]), door),
        Part("knobs", join([knobs for _, knobs in doors]), some_metal(rng)),
        Part("legs", four_legs(w, d, 0.08, 0.05), some_metal(rng)),
        surfaces=(
            Surface("television", (-0.6, -0.15), (0.6, 0.15), h),
            Surface("table", (-w / 2 + 0.01, 0.06), (w / 2 - 0.01, d / 2 + 0.01), h),
            Surface("shelf", (-w / 6 + 0.02, -0.1), (w / 6 - 0.02, 0.18), 0.1, h - 0.14),
        ),
    )


def bookcase(rng: Rng) -> Model:
    """Open shelves between sides, with a back."""
    body = some_wood(rng)
    w, d, rows = rng.uniform(0.75, 0.95), 0.3, int(rng.integers(4, 6))
    h = 0.36 * rows + 0.08
    heights = [0.06 + 0.36 * row for row in range(rows + 1)]
    boards = [box((-w / 2 + 0.02, y, -d / 2), (w / 2 - 0.02, y + 0.02, d / 2)) for y in heights]
    sides = [box((x - 0.01, 0, -d / 2), (x + 0.01, h, d / 2)) for x in (-w / 2 + 0.01, w / 2 - 0.01)]
    back = box((-w / 2 + 0.02, 0.06, -d / 2), (w / 2 - 0.02, h, -d / 2 + 0.01))
    ends = (-w / 2 + 0.04, -d / 2 + 0.03), (w / 2 - 0.04, d / 2 - 0.01)
    rooms = [0.33] * rows + [2.0]
    lining = cloth(rng, random_color(rng, (0.2, 0.5), (0.6, 0.9)), 0.2)
    return assemble(
        Part("shelves", join(boards), body),
        Part("sides", join(sides), body),
        Part("back", back, make_texture(lining, 0.5, surface="plain cloth")),
        surfaces=tuple(
            Surface("shelf", *ends, y + 0.02, room) for y, room in zip(heights, rooms, strict=True)
        ),
    )


def refrigerator(rng: Rng) -> Model:
    """Two doors with long handles; notes and magnets on the upper one."""
    steel = make_texture(metal(rng, random_color(rng, (0.0, 0.35), (0.65, 0.85))), 0.6, surface="metal")
    w, d, h = 0.64, 0.6, 1.75
    doors = [
        box((-w / 2 + 0.004, a, d / 2), (w / 2 - 0.004, b, d / 2 + 0.05))
        for a, b in ((0.06, 0.62), (0.635, h))
    ]
    handles = [
        rod((0.25, a, d / 2 + 0.085), (0.25, b, d / 2 + 0.085), 0.012) for a, b in ((0.3, 0.58), (0.68, 1.2))
    ]
    places = [(-0.2, 1.45), (-0.02, 1.2), (-0.22, 1.1), (0.02, 1.55), (-0.12, 0.9)]
    notes = [
        Part(
            f"note {number}",
            box((x, y, d / 2 + 0.05), (x + 0.1, y + 0.12, d / 2 + 0.053)),
            make_texture(landscape(rng, (96, 80)), 0.1, 0.12, surface="printed paper"),
        )
        for number, (x, y) in enumerate(places)
    ]
    feet = box((-w / 2 + 0.03, 0, -d / 2), (w / 2 - 0.03, 0.04, d / 2 - 0.03))
    return assemble(
        Part("body", box((-w / 2, 0.04, -d / 2), (w / 2, h, d / 2)), steel),
        Part("doors", join(doors), make_texture(metal(rng, (0.75, 0.76, 0.78)), 0.6, surface="metal")),
        Part("handles", join(handles), some_metal(rng)),
        Part("feet", feet, some_plastic(rng, (0.1, 0.1, 0.1))),
        *notes,
    )
