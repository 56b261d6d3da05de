"""ADT recordings: every file that is read, as rubbish and in part."""

import gzip
import random
from collections.abc import Iterator
from pathlib import Path

from bad_input_bench.cases import Case, Sandbox, Words, stage_flags
from bad_input_bench.mutations import JSON_RUBBISH, RUBBISH, Break, cut, fill, lose, replaced

FAMILY = "recordings: ADT"
POINTS = "mps/slam/semidense_points.csv.gz"
TRAJECTORY = "mps/slam/closed_loop_trajectory.csv"
SEGMENTATION = "segmentations_with_skeleton.vrs"

READ_BY = {
    "video.vrs": "frames",
    "metadata.json": "frames",
    SEGMENTATION: "annotations",
    "instances.json": "annotations",
    TRAJECTORY: "poses",
    POINTS: "poses",
}
"""By which stage a file is read."""

ABSENT = {
    "metadata.json": "recordings of before 2024 have none; without it one is real",
    SEGMENTATION: "some releases lack it; without it another is read, or nothing is annotated, and a line says so",
}
"""Files that may be absent, and why."""


def cases(rng: random.Random) -> Iterator[Case]:
    """All of this family."""
    for file, stage in READ_BY.items():
        for what, change in RUBBISH.items():
            yield _case(stage, file, what, change, ABSENT.get(file, "") if what == "absent" else "")
    for what, change in JSON_RUBBISH.items():
        yield _case("annotations", "instances.json", what, change)
        odd = what in ("a list", "a number", "null", "NaN", "an empty object", "a number of 5000 digits")
        fine = "it is JSON that does not call the recording synthetic, so it is real" if odd else ""
        yield _case("frames", "metadata.json", what, change, fine)
    for share in sorted(round(rng.uniform(0.01, 0.99), 3) for _ in range(6)):
        yield _case("frames", "video.vrs", f"{share} of it", cut(share))
        yield _case("annotations", SEGMENTATION, f"{share} of it", cut(share))
    yield from _instances()
    yield from _tables()
    yield _case("frames", "video.vrs", "its segmentation", lambda path: _take(path, SEGMENTATION))
    yield _case("annotations", SEGMENTATION, "its video", lambda path: _take(path, "video.vrs"))
    yield _case("poses", TRAJECTORY, "its points", lambda path: _take(path, f"../../{POINTS}"))


def _take(path: Path, other: str) -> None:
    path.write_bytes((path.parent / other).read_bytes())


def _case(stage: str, file: str, what: str, change: Break, fine: str = "") -> Case:
    def command(box: Sandbox) -> Words:
        change(box.recording / file)
        return stage_flags(stage, box)

    name = Path(file).name
    return Case(FAMILY, f"{name}: {what}", command, (name, "recording"), fine)


def _instances() -> Iterator[Case]:
    entry = '{"1": {"instance_id": %s, "instance_name": %s, "category": "c", "motion_type": %s, "instance_type": "object"}}'
    odd = {
        "an id beyond 64 bits": ("99999999999999999999999999", '"a"', '"static"'),
        "an id below 1": ("-5", '"a"', '"static"'),
        "an id in words": ('"one"', '"a"', '"static"'),
        "an id that is a list": ("[1]", '"a"', '"static"'),
        "a motion that is a list": ("1", '"a"', "[]"),
        "a motion that there is not": ("1", '"a"', '"flying"'),
        "ids of another recording": ("1", '"a"', '"static"'),
    }
    for what, values in odd.items():
        yield _case("annotations", "instances.json", what, fill(entry % values))
    yield _case("annotations", "instances.json", "an entry that is a list", fill('{"1": []}'))


def _tables() -> Iterator[Case]:
    numbers = {"nan": "nan", "infinite": "inf", "1e300": "1e300", "words": "far", "empty": ""}
    for what, number in numbers.items():
        for column in ("tx_world_device", "qw_world_device", "tracking_timestamp_us", "gravity_z_world"):
            yield _case("poses", TRAJECTORY, f"{column} {what}", _column(column, number))
    yield _case("poses", TRAJECTORY, "without a column", replaced("tx_world_device", "x", 1))
    yield _case("poses", TRAJECTORY, "its first line alone", lambda path: _lines(path, 1))
    yield _case("poses", TRAJECTORY, "two rows", lambda path: _lines(path, 3))
    for what, number in numbers.items():
        if what in ("words", "nan"):
            yield _case("poses", POINTS, f"px_world {what}", _points(number))
    yield _case("poses", POINTS, "no gzip", fill("uid,graph_uid\n"))
    yield _case("poses", POINTS, "gzip of nothing", fill(gzip.compress(b"")))
    yield _case("poses", POINTS, "gzip of zero bytes", fill(gzip.compress(b"\0" * 10_000)))
    yield _case("poses", "mps", "absent", lose)


def _column(name: str, value: str) -> Break:
    """Put a value into all rows but the first ones."""

    def change(path: Path) -> None:
        rows = [line.split(",") for line in path.read_text().splitlines()]
        place = rows[0].index(name)
        for row in rows[5:]:
            row[place] = value
        path.write_text("\n".join(",".join(row) for row in rows))

    return change


def _lines(path: Path, count: int) -> None:
    path.write_text("\n".join(path.read_text().splitlines()[:count]) + "\n")


def _points(value: str) -> Break:
    def change(path: Path) -> None:
        lines = gzip.decompress(path.read_bytes()).decode().splitlines()
        place = lines[0].split(",").index("px_world")
        rows = [line.split(",") for line in lines[1:]]
        changed = [",".join([*row[:place], value, *row[place + 1 :]]) for row in rows]
        path.write_bytes(gzip.compress("\n".join([lines[0], *changed]).encode()))

    return change
