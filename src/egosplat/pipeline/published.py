"""The catalogue of published checkpoints that ``egosplat models download`` can fetch."""

import os
from dataclasses import dataclass
from pathlib import Path

from egosplat.errors import UserError

# The value of a checkpoint's key that stands for the published checkpoint of the configured architecture.
PUBLISHED = "published"


@dataclass(frozen=True)
class PublishedModel:
    """A checkpoint that its authors publish.

    Attributes:
        library: ``SAM2``, ``OpenCLIP`` or ``timm``.
        architecture: its name in the library, as the keys ``models.sam2_config`` and ``models.clip_model`` take it.
        weights: the authors' name of the weights.
        file: name in the folder ``models.cache``.
        repository, remote, revision: where the file is on the Hugging Face hub.
        license: of the weights.
        megabytes: size of the file [10^6 bytes], rounded.
        sha256: digest that is published with the file; None if none is known for certain.
    """

    library: str
    architecture: str
    weights: str
    file: str
    repository: str
    remote: str
    license: str
    megabytes: float
    sha256: str | None
    revision: str = "main"

    @property
    def address(self) -> str:
        """Where the file is fetched from."""
        return f"{hub()}/{self.repository}/resolve/{self.revision}/{self.remote}"


def hub() -> str:
    """Get the address of the Hugging Face hub, or of its mirror if the environment variable HF_ENDPOINT names one."""
    return os.environ.get("HF_ENDPOINT", "").rstrip("/") or "https://huggingface.co"


def _sam2(size: str, letters: str, megabytes: float, sha256: str) -> PublishedModel:
    file = f"sam2.1_hiera_{size}.pt"
    place = (f"facebook/sam2.1-hiera-{size.replace('_', '-')}", file)
    return PublishedModel(
        "SAM2", f"sam2.1_hiera_{letters}", "SAM2.1", file, *place, "Apache-2.0", megabytes, sha256
    )


def _clip(
    architecture: str,
    weights: str,
    repository: str,
    license: str,
    size: float,
    sha256: str | None,
    *revision: str,
) -> PublishedModel:
    file, remote = f"{architecture}.{weights}.bin", "open_clip_pytorch_model.bin"
    about = (file, repository, remote, license, size, sha256, *revision)
    return PublishedModel("OpenCLIP", architecture, weights, *about)


# The digests of SAM2.1 are those of the same files on Meta's server; the others are on the files' pages of the hub. No digest
# of the DataComp weights was found.
CATALOGUE = (
    _sam2("tiny", "t", 156.0, "7402e0d864fa82708a20fbd15bc84245c2f26dff0eb43a4b5b93452deb34be69"),
    _sam2("small", "s", 184.4, "6d1aa6f30de5c92224f8172114de081d104bbd23dd9dc5c58996f0cad5dc4d38"),
    _sam2("base_plus", "b+", 323.6, "a2345aede8715ab1d5d31b4a509fb160c5a4af1970f199d9054ccfb746c004c5"),
    _sam2("large", "l", 898.1, "2647878d5dfa5098f2f8649825738a9345572bae2d4350a2468587ece47dd318"),
    _clip(
        *("ViT-B-16", "laion2b_s34b_b88k", "laion/CLIP-ViT-B-16-laion2B-s34B-b88K", "MIT", 599),
        "1f16b1274ca25493b1f36225efe81d05f66a3f33c487acd1a07c5ba87920de6f",
    ),
    _clip(
        *("ViT-B-16-quickgelu", "dfn2b", "apple/DFN2B-CLIP-ViT-B-16", "Apple's own, see its page", 599),
        "01832e9567e6f668928c6ef493fe9c0985f9df146e0212bdccc87f3e25e37084",
        "8fdf8d1c80647d79d7e109ddebd3b7fc51108531",
    ),
    _clip(
        "ViT-L-14", "datacomp_xl_s13b_b90k", "laion/CLIP-ViT-L-14-DataComp.XL-s13B-b90K", "MIT", 1710, None
    ),
    PublishedModel(
        "timm",
        "mobilenetv3_small_050",
        "lamb_in1k",
        "mobilenetv3_small_050.lamb_in1k.safetensors",
        "timm/mobilenetv3_small_050.lamb_in1k",
        "model.safetensors",
        "Apache-2.0",
        6.4,
        "2e3f6937afd4b3704450518a2710168775d6c70ebfb7a0e9aaf06200c6fbe0c4",
        "f58e7345afe2832abd6f81cc60f67cd1ddf7ce00",
    ),
)

# The library of each key that takes ``published``.
LIBRARIES = {
    "models.sam2_checkpoint": "SAM2",
    "models.clip_checkpoint": "OpenCLIP",
    "transient.encoder_weights": "timm",
}

# The transient network's encoder; no key names it.
ENCODER = "mobilenetv3_small_050"


def published_model(key: str, architecture: str) -> PublishedModel:
    """Get the published checkpoint of an architecture for one of ``LIBRARIES`` (UserError: there is none)."""
    known = {one.architecture: one for one in CATALOGUE if one.library == LIBRARIES[key]}
    name = architecture.removesuffix(".yaml").rpartition("/")[2]
    if name not in known:
        raise UserError(
            f"{key} = published: egosplat's catalogue has no checkpoint of {architecture!r}. "
            f"Set {key} to a file, or take an architecture of {', '.join(known)}"
        )
    return known[name]


def named_model(name: str) -> PublishedModel:
    """Get a checkpoint by its architecture or file name (UserError: the catalogue has none of that name)."""
    for one in CATALOGUE:
        if name in (one.architecture, one.file):
            return one
    names = ", ".join(one.architecture for one in CATALOGUE)
    raise UserError(f"{name[:80]}: is not in the catalogue, which has {names}")


def model_of_file(path: Path) -> PublishedModel | None:
    """Get the catalogue's entry for a file, by its name."""
    return next((one for one in CATALOGUE if one.file == path.name), None)
