"""Write Gaussians in the formats of other programs, by their descriptions alone."""

import gzip
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.gaussians.model import Gaussians

Columns = dict[str, NDArray]
SH_C0 = 0.28209479177387814


def gsplat_columns(gaussians: Gaussians) -> Columns:
    """The properties of gsplat's ``export_splats`` in their order: no normals, colors by channel."""
    parts = {name: tensor.detach().numpy() for name, tensor in gaussians.parameters().items()}
    found = dict(zip("xyz", parts["means"].T, strict=True))
    for channel in range(3):
        found[f"f_dc_{channel}"] = parts["sh"][:, 0, channel]
    rest = parts["sh"].shape[1] - 1
    for number in range(3 * rest):
        found[f"f_rest_{number}"] = parts["sh"][:, 1 + number % rest, number // rest]
    found["opacity"] = parts["logit_opacities"]
    found |= {f"scale_{axis}": parts["log_scales"][:, axis] for axis in range(3)}
    return found | {f"rot_{axis}": parts["quats"][:, axis] for axis in range(4)}


def ply(
    columns: Columns,
    order: str = "binary_little_endian",
    number: str = "float",
    comments: tuple[str, ...] = (),
) -> bytes:
    """A .ply file with one element, ``vertex``."""
    count = len(next(iter(columns.values())))
    lines = [
        "ply",
        f"format {order} 1.0",
        *(f"comment {each}" for each in comments),
        f"element vertex {count}",
    ]
    lines += [f"property {number} {name}" for name in columns]
    head = "\n".join([*lines, "end_header", ""]).encode()
    table = np.stack(list(columns.values()), axis=1)
    if order == "ascii":
        return head + "\n".join(" ".join(repr(float(value)) for value in row) for row in table).encode()
    sign = ">" if order == "binary_big_endian" else "<"
    return head + table.astype(sign + {"float": "f4", "double": "f8"}[number]).tobytes()


def packed_ply(gaussians: Gaussians) -> bytes:
    """SuperSplat's compressed .ply: chunks of 256 Gaussians with their limits, 16 bytes a Gaussian, a byte a coefficient."""
    parts = {name: tensor.detach().double().numpy() for name, tensor in gaussians.parameters().items()}
    count, rest = parts["sh"].shape[0], parts["sh"].shape[1] - 1
    chunks, words = [], []
    for start in range(0, count, 256):
        rows = slice(start, start + 256)
        position, scale = parts["means"][rows], parts["log_scales"][rows]
        color = parts["sh"][rows, 0] * SH_C0 + 0.5
        shares = [_share(values) for values in (position, scale, color)]
        chunks.append(
            np.concatenate([np.concatenate([v.min(0), v.max(0)]) for v in (position, scale, color)])
        )
        alpha = 1 / (1 + np.exp(-parts["logit_opacities"][rows]))
        words.append(
            np.stack(
                [
                    _bits(shares[0], (11, 10, 11)),
                    _rotation_bits(parts["quats"][rows]),
                    _bits(shares[1], (11, 10, 11)),
                    _bits(np.column_stack([shares[2], alpha]), (8, 8, 8, 8)),
                ],
                axis=1,
            )
        )
    ends = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
    limits = [f"{end}_{axis}" for axes in ends for end in ("min", "max") for axis in axes]
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {len(chunks)}"]
    lines += [f"property float {name}" for name in limits] + [f"element vertex {count}"]
    lines += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    coefficients = parts["sh"][:, 1:].transpose(0, 2, 1).reshape(count, -1)
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{number}" for number in range(3 * rest))]
    head = "\n".join([*lines, "end_header", ""]).encode()
    sh = np.clip((coefficients / 8 + 0.5) * 256, 0, 255).astype(np.uint8)
    return (
        head
        + np.array(chunks, "<f4").tobytes()
        + np.concatenate(words).astype("<u4").tobytes()
        + sh.tobytes()
    )


def _share(values: NDArray) -> NDArray:
    span = values.max(0) - values.min(0)
    return np.where(span < 1e-5, 0.0, (values - values.min(0)) / np.where(span < 1e-5, 1.0, span))


def _bits(shares: NDArray, widths: tuple[int, ...]) -> NDArray[np.uint32]:
    packed = np.zeros(len(shares), np.uint32)
    for column, width in enumerate(widths):
        most = (1 << width) - 1
        packed = packed << np.uint32(width) | np.clip(shares[:, column] * most + 0.5, 0, most).astype(
            np.uint32
        )
    return packed


def _rotation_bits(quats: NDArray) -> NDArray[np.uint32]:
    packed = []
    for quat in quats / np.linalg.norm(quats, axis=1, keepdims=True):
        largest = int(np.abs(quat).argmax())
        some = np.delete(quat * np.sign(quat[largest]), largest) * 0.5**0.5 + 0.5
        packed.append((largest << 30) | int(_bits(some[None], (10, 10, 10))[0]))
    return np.array(packed, np.uint32)


def spz(gaussians: Gaussians, version: int, fraction: int = 16) -> bytes:
    """An .spz file of version 2 or 3, with the axes of OpenGL; ``fraction``: bits after the point of a coordinate."""
    parts = {name: tensor.detach().double().numpy() for name, tensor in gaussians.parameters().items()}
    count, rest = parts["sh"].shape[0], parts["sh"].shape[1] - 1
    degree = {0: 0, 3: 1, 8: 2, 15: 3}[rest]
    axes = np.array([1.0, -1.0, -1.0])
    places = np.round(parts["means"] * axes * 2**fraction).astype("<i4")
    quats = parts["quats"] / np.linalg.norm(parts["quats"], axis=1, keepdims=True)
    # x, y, z, w, as the format has it.
    quats = np.column_stack([quats[:, 1:] * axes, quats[:, :1]])
    # Of degree 1 to 3, in the order of the coefficients: whether a change of the signs of y and z changes theirs.
    signs = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1])[:rest]
    sections = [
        places.reshape(-1).view("u1").reshape(-1, 4)[:, :3],
        _byte(255 / (1 + np.exp(-parts["logit_opacities"]))),
        _byte(parts["sh"][:, 0] * 0.15 * 255 + 127.5),
        _byte((parts["log_scales"] + 10) * 16),
        _turns(quats, version),
        _byte(parts["sh"][:, 1:] * signs[:, None] * 128 + 128),
    ]
    head = struct.pack("<IIIBBBB", 0x5053474E, version, count, degree, fraction, 0, 0)
    return gzip.compress(head + b"".join(part.tobytes() for part in sections), mtime=0)


def _byte(values: NDArray) -> NDArray[np.uint8]:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _turns(quats: NDArray, version: int) -> NDArray:
    """Version 2: x, y, z in a byte each, w not negative. Version 3: the three smallest, in ten bits each."""
    if version == 2:
        return _byte((quats * np.sign(quats[:, 3:]))[:, :3] * 127.5 + 127.5)
    packed = []
    for quat in quats:
        largest = int(np.abs(quat).argmax())
        word = largest
        for index in range(4):
            if index != largest:
                value = quat[index] * np.sign(quat[largest])
                word = word << 10 | int(value < 0) << 9 | int(511 * abs(value) / 0.5**0.5 + 0.5)
        packed.append(word)
    return np.array(packed, "<u4")


def write(path: Path, content: bytes) -> Path:
    """Write a file; returns its path."""
    path.write_bytes(content)
    return path
