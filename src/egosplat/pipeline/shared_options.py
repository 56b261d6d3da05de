"""Options that several stages share, by section of the configuration."""

from typing import Literal

from egosplat.pipeline.options import Natural, Options, Positive, Share, Text


class SeedOptions(Options, section="run"):
    """Seed of random choices."""

    seed: Natural = 0
    """Seed of all random choices of training: order of frames, subsets of points, initial weights."""


class BackendOptions(Options, section="run"):
    """Renderer of Gaussians."""

    backend: Literal["auto", "cuda", "cpu", "reference"] = "auto"
    """Renderer. cuda: gsplat on a GPU. cpu: compiled kernels. reference: plain PyTorch, slow. auto: the fastest that is
    available."""


class DeviceOptions(Options, section="run"):
    """Device and number type of the models."""

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Device of the models. auto uses the GPU if PyTorch finds one, which is many times faster."""

    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """Number type of the models' matrix products. bfloat16 is faster on a GPU and changes scores in the third digit.
    float32 is exact and fastest on a CPU. auto chooses by the device."""


class NearPlaneOptions(Options, section="run"):
    """Near plane of the renderer."""

    near_plane: Positive = 0.1
    """Near plane in meters (scene units if the scale is unknown): nothing closer to the camera is rendered. Too near,
    single Gaussians in front of the lens fill the frame; too far, hands are cut off. Training stops where most points
    lie closer. The smallest sizes are in proportion to it."""


class RunOptions(SeedOptions, BackendOptions, DeviceOptions, NearPlaneOptions):
    """How stages run, for all of them together."""


class SetOptions(Options, section="models"):
    """The set of models."""

    set: Literal["auto", "small", "photos", "light", "published"] = "auto"
    """Which models (docs/models.md): small (bundled, of synthetic apartments only), photos (a small SAM2, and words of
    ImageNet's classes), light (SAM2.1 tiny and a fast OpenCLIP, which egosplat run takes for recordings), published (the
    paper's), or auto: small for egosplat's apartments, else photos (a stage by hand: small). Keys whose best value
    depends on the model have a default for each set; a key that you set yourself wins."""


class Sam2Options(Options, section="models"):
    """SAM2's architecture and weights."""

    sam2_config: Text = "small"
    """SAM2 architecture: small (bundled), a name of the package sam2 such as sam2.1_hiera_b+ (the paper's), or a
    YAML file. Larger models segment better and are much slower without a GPU."""

    sam2_checkpoint: Text = "small"
    """SAM2 weights: small (bundled, trained on synthetic apartments only), photos (bundled, trained further on plainer
    ones), published (those of sam2_config in the folder cache), or a .pt or .safetensors file that fits sam2_config."""


class ClipOptions(Options, section="models"):
    """OpenCLIP's architecture and weights."""

    clip_model: Text = "small"
    """OpenCLIP architecture: small (bundled), photos (ImageNet's classes and sentences, docs/models.md), a name of the package open_clip such as ViT-B-16 (the paper's), or a
    folder with open_clip_config.json. Larger models know more words and are slower."""

    clip_checkpoint: Text = "small"
    """OpenCLIP weights: small (bundled, knows only the words of synthetic apartments), photos, published (those of
    clip_model in the folder cache), or a .bin, .pt or .safetensors file that fits clip_model."""


class ModelsOptions(SetOptions, Sam2Options, ClipOptions, section="models"):
    """The segmentation and embedding models, shared by all stages that need one."""

    cache: Text = "checkpoints"
    """Folder of the published checkpoints, relative to the working directory."""


class ThresholdOptions(Options, section="masks"):
    """From when an instance counts as moving."""

    threshold: Share = 0.7
    """Mean probability from which an instance is transient. Lower masks more. The paper uses 0.02 for ADT and 0.1
    for HOI4D. The best value depends on transient_penalty, lr and iterations of transient; with their defaults 0.65
    to 0.75 work equally well. Where segments tracks what moves, a mask starts a track from six sevenths of it."""


class MaskSourceOptions(Options, section="segments"):
    """How masks are found."""

    segmenter: Literal["sam2", "classical"] = "sam2"
    """Segmentation method. sam2: the model of the section models. classical: color and edges, tracked by optical
    flow; it needs no weights and suits recordings that the small SAM2 was not trained for."""


class CameraOptions(Options, section="camera"):
    """What the training of Gaussians corrects about the camera (docs/method.md#corrections)."""

    refine_poses: Literal["auto", "on", "off"] = "auto"
    """Refine the pose of each training frame together with the Gaussians: a small rigid motion a frame, by gradient
    descent. It costs time and helps where poses are off by millimeters or more. auto: if the survey finds that the
    poses do not explain the pictures; by hand, as the given survey says, else off."""

    compensate_exposure: Literal["auto", "on", "off"] = "auto"
    """Give each training frame a gain of red, green and blue, which its render gets before it is compared. It helps
    where auto-exposure or white balance change; the Gaussians keep the mean exposure. auto: if the survey finds
    that the brightness of the same surfaces changes; by hand, as the given survey says, else off."""
