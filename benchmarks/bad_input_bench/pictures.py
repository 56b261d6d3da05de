"""Plain recordings with their annotations: photographs, videos, tables and masks."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from bad_input_bench.cases import Case, Sandbox, Words, flags
from bad_input_bench.mutations import JSON_RUBBISH, RUBBISH, Break, as_folder, cut, fill

SIZE = 64
CAMERA = '{"width": %s, "height": 64, "fx": %s, "fy": 60, "cx": 32, "cy": 32}'
TABLE = "id\tname\tcategory\tmotion_type\n"


def cases(rng: random.Random) -> Iterator[Case]:
    """All of these families."""
    yield from _photographs(rng)
    yield from _videos(rng)
    yield from _annotations()


def folder_of_pictures(folder: Path, count: int = 4) -> Path:
    """A plain recording."""
    folder.mkdir(parents=True)
    noise = np.random.default_rng(0)
    for index in range(count):
        picture = noise.integers(0, 255, (SIZE, SIZE, 3), np.uint8)
        cv2.imwrite(str(folder / f"{index}.png"), picture)
    return folder


def video(path: Path, count: int = 6) -> Path:
    """A short one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 15, (SIZE, SIZE))
    for index in range(count):
        writer.write(np.full((SIZE, SIZE, 3), 40 * index, np.uint8))
    writer.release()
    return path


def frames(recording: Path, box: Sandbox, format: str = "plain", **changes: object) -> Words:
    """The stage ``frames`` of it."""
    given = {"format": format, "resolution": SIZE, "evaluation_frames": 1, "output": box.new}
    return flags("frames", recording=recording, **(given | changes))


def _picture(what: str, change: Callable[[Path], object], file: str = "2.png", fine: str = "") -> Case:
    def command(box: Sandbox) -> Words:
        folder = folder_of_pictures(box.folder / "photos")
        if file in ("camera.json", "valid.png"):
            (folder / file).touch()
        change(folder / file)
        return frames(folder, box)

    return Case("recordings: photographs", f"{file}: {what}", command, (file, "photos"), fine)


def _photographs(rng: random.Random) -> Iterator[Case]:
    gone = "the other pictures are the recording"
    for what, change in RUBBISH.items():
        absent = what in ("absent", "a folder", "a link to nothing", "a link to itself")
        yield _picture(what, change, fine=gone if absent else "")
        if what != "absent":
            yield _picture(what, change, "camera.json")
            yield _picture(what, change, "valid.png")
    for share in sorted(round(rng.uniform(0.05, 0.95), 3) for _ in range(4)):
        yield _picture(f"{share} of it", cut(share))
    for what, change in JSON_RUBBISH.items():
        yield _picture(what, change, "camera.json")
    odd = {
        "another size": ("65", "60"),
        "focal length 0": ("64", "0"),
        "focal length NaN": ("64", "NaN"),
        "focal length infinite": ("64", "1e999"),
        "focal length of 400 digits": ("64", "9" * 400),
        "focal length in words": ("64", '"long"'),
        "focal length a list": ("64", "[60]"),
    }
    for what, values in odd.items():
        yield _picture(what, fill(CAMERA % values), "camera.json")
    yield _picture(
        "16 bits",
        lambda path: cv2.imwrite(str(path), np.full((SIZE, SIZE, 3), 40_000, np.uint16)),
        fine="colours of 16 bits are brought to 8",
    )
    yield _picture("another size", lambda path: cv2.imwrite(str(path), np.zeros((32, SIZE, 3), np.uint8)))
    yield _picture("said to be 60000 pixels wide", _claims_to_be_huge)
    yield _picture(
        "all black", lambda path: cv2.imwrite(str(path), np.zeros((SIZE, SIZE), np.uint8)), "valid.png"
    )
    yield _picture(
        "another size", lambda path: cv2.imwrite(str(path), np.zeros((9, 9), np.uint8)), "valid.png"
    )
    for name in ("no such folder", "-r", "a\nb", "$(touch ..)", "x" * 300):
        yield Case(
            "recordings: photographs",
            f"a recording called {name[:20]!r} that there is not",
            lambda box, name=name: frames(Path(name), box),
            (name[:20], repr(name)[1:-1]),
        )
    for flag, value in {
        "start_s": 1e300,
        "stride": 2**31 - 1,
        "evaluation_frames": 3,
        "resolution": 65,
    }.items():
        name = f"{flag} {value:g}"
        yield Case(
            "recordings: photographs",
            name,
            lambda box, flag=flag, value=value: frames(
                folder_of_pictures(box.folder / "photos"), box, **{flag: value}
            ),
            ("photos", flag, "evaluation"),
        )


def _claims_to_be_huge(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[16:24] = (60_000).to_bytes(4, "big") * 2
    path.write_bytes(content)


def _videos(rng: random.Random) -> Iterator[Case]:
    ways = {what: change for what, change in RUBBISH.items() if what not in ("all but its end", "a folder")}
    ways |= {
        f"{share} of it": cut(share) for share in sorted(round(rng.uniform(0.1, 0.9), 3) for _ in range(3))
    }
    for what, change in ways.items():
        yield _video(what, change)
    yield _video("an empty folder", as_folder)


def _video(what: str, change: Break) -> Case:
    def command(box: Sandbox) -> Words:
        path = video(box.folder / "clip.mp4")
        change(path)
        return frames(path, box)

    return Case("recordings: videos", f"clip.mp4: {what}", command, ("clip.mp4",))


def _annotated(what: str, table: Break, png: Break | None = None, fine: str = "") -> Case:
    """Annotations of photographs; their frames are made before."""

    def command(box: Sandbox) -> Words:
        from egosplat.frames.stage import run

        folder = folder_of_pictures(box.folder / "photos")
        made = box.folder / "frames.zarr"
        options = {
            "resolution": SIZE,
            "focal": 460.0,
            "upright": True,
            "stride": 1,
            "start_s": 0.0,
            "end_s": None,
        }
        run(folder, made, format="plain", evaluation_frames=4, holdout=False, **options)
        (folder / "annotations").mkdir()
        (folder / "annotations/instances.tsv").write_text(f"{TABLE}1\tcup\tcup\tstatic\n")
        cv2.imwrite(str(folder / "annotations/2.png"), np.ones((SIZE, SIZE), np.uint8))
        table(folder / "annotations/instances.tsv")
        if png is not None:
            png(folder / "annotations/2.png")
        return flags("annotations", recording=folder, frames=made, output=box.new)

    return Case("annotations: photographs", what, command, ("instances.tsv", ".png", "annotations"), fine)


def _annotations() -> Iterator[Case]:
    rows = {
        "an id below 1": "0\ta\tb\tstatic\n",
        "an id of 5000 digits": "9" * 5000 + "\ta\tb\tstatic\n",
        "an id with a sign": "+1\ta\tb\tstatic\n",
        "an id in other digits": "\u0661\ta\tb\tstatic\n",
        "an id twice": "1\ta\tb\tstatic\n" * 2,
        "no category": "1\ta\t\tstatic\n",
        "a motion that there is not": "1\ta\tb\tflying\n",
        "a row too short": "1\ta\n",
        "a field of a megabyte": "1\t" + "x" * 2**20 + "\tb\tstatic\n",
        "an id that no pixel has": "7\ta\tb\tstatic\n",
    }
    for what, row in rows.items():
        yield _annotated(f"instances.tsv: {what}", fill(TABLE + row))
    for what, change in RUBBISH.items():
        if what == "all but its end":
            continue  # a shorter category
        yield _annotated(f"instances.tsv: {what}", change)
        absent = what == "absent"
        fine = "a picture without a mask is not annotated" if absent else ""
        yield _annotated(f"2.png: {what}", lambda _: None, change, fine)
    odd = {"three channels": np.ones((SIZE, SIZE, 3), np.uint8), "another size": np.ones((9, SIZE), np.uint8)}
    for what, picture in odd.items():
        yield _annotated(
            f"2.png: {what}", lambda _: None, lambda path, picture=picture: cv2.imwrite(str(path), picture)
        )
    yield _annotated(
        "a mask of no picture",
        lambda _: None,
        lambda path: path.rename(path.with_name("no $(touch ..).png")),
    )
