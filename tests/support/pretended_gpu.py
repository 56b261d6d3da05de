"""A GPU that is pretended: tensors that report another device, are computed on the CPU, and must not mix with others. PyTorch's own
fake tensors cannot run a backward pass. Here each tensor of the device is a wrapper that reports the device ``meta`` and holds a CPU
tensor; a dispatch mode unwraps, computes on the CPU and wraps again. It counts the reads for which a GPU would make the CPU wait."""

import contextlib
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Self

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

from egosplat.rasterize import api, cuda
from egosplat.rasterize.api import rasterization
from egosplat.rasterize.reference.spherical_harmonics import spherical_harmonics

DEVICE = torch.device("meta")

aten = torch.ops.aten

# Their results have a size that only the device knows.
_OF_UNKNOWN_SIZE = {
    aten.nonzero.default,
    aten.masked_select.default,
    aten._unique2.default,
    aten.unique_dim.default,
    aten.unique_consecutive.default,
    aten.repeat_interleave.Tensor,
    aten.bincount.default,
}
_READS = {aten._local_scalar_dense.default, aten.equal.default, aten.is_nonzero.default}
_INDEXING = {
    aten.index.Tensor,
    aten.index_put.default,
    aten.index_put_.default,
    aten._index_put_impl_.default,
}
# These check for errors, which reads a flag.
_CHECKED = {aten._linalg_check_errors.default}


class OnDevice(Tensor):
    """A tensor of the pretended device; ``held`` is the CPU tensor behind it."""

    held: Tensor

    @staticmethod
    def __new__(cls, held: Tensor) -> Self:
        return Tensor._make_wrapper_subclass(
            cls,
            held.size(),
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            device=DEVICE,
            requires_grad=False,
        )

    def __init__(self, held: Tensor) -> None:
        self.held = held

    def __repr__(self) -> str:
        return f"OnDevice({self.held})"

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        with PretendedGpu.now:
            return function(*args, **kwargs or {})

    def __reduce_ex__(self, protocol: Any) -> Any:
        # In a checkpoint it is a plain tensor.
        return self.held.__reduce_ex__(protocol)

    def tolist(self) -> Any:
        PretendedGpu.now.wait("tolist")
        return self.held.tolist()


@dataclass
class PretendedGpu(TorchDispatchMode):
    """Within it, ``DEVICE`` is a GPU. ``waits``: places of the package whose reads made the CPU wait, with
    their number. ``mixed``: operations on tensors of both devices."""

    waits: Counter[str] = field(default_factory=Counter)
    mixed: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        PretendedGpu.now = self

    def wait(self, what: str) -> None:
        """Count a read."""
        self.waits[f"{place()} {what}"] += 1

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        flat, _ = tree_flatten((args, kwargs))
        tensors = [value for value in flat if isinstance(value, Tensor)]
        ours = [value for value in tensors if isinstance(value, OnDevice)]
        target = kwargs.get("device")
        wanted = None if target is None else torch.device(target).type == DEVICE.type
        if wanted:
            kwargs["device"] = torch.device("cpu")
        on_device = bool(ours) if wanted is None else wanted
        self._check(function, tensors, ours, args, wanted)
        result = function(*tree_map(_held, args), **tree_map(_held, kwargs))
        if function in _READS or not on_device:
            return result
        return _wrapped(function, args, kwargs, result)

    def _check(self, function: Any, tensors: list, ours: list, args: Any, wanted: bool | None) -> None:
        copied = function in (aten._to_copy.default, aten.copy_.default)
        numbers = [value for value in tensors if not isinstance(value, OnDevice) and value.dim() > 0]
        # An index on the CPU is copied to the device by PyTorch itself.
        indexed = function in _INDEXING and isinstance(args[0], OnDevice)
        if ours and numbers and not copied and not indexed:
            self.mixed.append(f"{place()} {function}")
        if not ours:
            return
        if wanted is False or (function is aten.copy_.default and not isinstance(args[0], OnDevice)):
            self.wait("copy to the CPU")
        elif function in _READS | _OF_UNKNOWN_SIZE | _CHECKED:
            self.wait(str(function))
        elif function in _INDEXING and any(_is_mask(index) for index in args[1]):
            self.wait("boolean index")


def _is_mask(index: Any) -> bool:
    return isinstance(index, Tensor) and index.dtype in (torch.bool, torch.uint8)


def _held(value: Any) -> Any:
    return value.held if isinstance(value, OnDevice) else value


def _wrapped(function: Any, args: Any, kwargs: Any, result: Any) -> Any:
    """Wrap what an operation returned; one in place returns the tensor that it changed."""
    known = {
        id(value.held): value for value in tree_flatten((args, kwargs))[0] if isinstance(value, OnDevice)
    }

    def wrap(value: Any) -> Any:
        if not isinstance(value, Tensor) or isinstance(value, OnDevice):
            return value
        found = known.get(id(value))
        return OnDevice(value) if found is None else found

    return tree_map(wrap, result)


def place() -> str:
    """File and function of the package that called, or ``elsewhere``."""
    frame = sys._getframe()
    while frame := frame.f_back:
        if found := re.search(r"/src/egosplat/(.*)$", frame.f_code.co_filename):
            return f"{found[1]}:{frame.f_code.co_name}"
    return "elsewhere"


class Gsplat:
    """gsplat's interface on the pretended device, computed by the kernels for the CPU."""

    def spherical_harmonics(self, degree: int, dirs: Tensor, coeffs: Tensor, masks: Tensor) -> Tensor:
        """(C, N, 3) values of the harmonics."""
        units = torch.nn.functional.normalize(torch.where(masks[..., None], dirs, 1.0), dim=-1)
        return spherical_harmonics(degree, units.flatten(0, 1), coeffs.flatten(0, 1)).reshape(dirs.shape)

    def rasterization(
        self, *, packed: bool, channel_chunk: int, **arguments: Any
    ) -> tuple[Tensor, Tensor, dict[str, Any]]:
        """Image, alpha and meta of one camera."""
        arguments["colors"] = arguments["colors"].reshape(len(arguments["means"]), -1)
        names = [name for name, value in arguments.items() if isinstance(value, Tensor)]
        # Each input of the kernels must be on the device, which the real kernels would not check.
        for name in names:
            assert isinstance(arguments[name], OnDevice), f"{name} is not on the device"
        kernels = _Kernels(arguments)
        means2d = _Project.apply(kernels, arguments["means"])
        image, alpha = _Composite.apply(kernels, names, means2d, *(arguments[name] for name in names))
        meta = {
            name: OnDevice(kernels.meta[name].detach()) for name in ("radii", "depths", "conics", "opacities")
        }
        sizes = {name: kernels.meta[name] for name in ("width", "height", "n_cameras")}
        return image, alpha, meta | sizes | {"means2d": means2d}


class _Kernels:
    """One call of the kernels, with its graph."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.leaves = {
            name: value.held.detach().requires_grad_(name != "Ks")
            for name, value in arguments.items()
            if isinstance(value, Tensor)
        }
        with torch.enable_grad():
            self.image, self.alpha, self.meta = rasterization(**arguments | self.leaves, backend="cpu")


class _Project(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, kernels: _Kernels, means: Tensor) -> Tensor:
        return OnDevice(kernels.meta["means2d"].detach())

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, None]:
        # ``_Composite`` has the whole gradient by the means already.
        return None, None


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, kernels: _Kernels, names: list[str], means2d: Tensor, *inputs: Tensor
    ) -> tuple[Tensor, Tensor]:
        ctx.kernels, ctx.names = kernels, names
        return OnDevice(kernels.image.detach()), OnDevice(kernels.alpha.detach())

    @staticmethod
    def backward(ctx: Any, v_image: Tensor, v_alpha: Tensor) -> tuple[Tensor | None, ...]:
        kernels = ctx.kernels
        wanted = [kernels.meta["means2d"], *(kernels.leaves[name] for name in ctx.names if name != "Ks")]
        found = torch.autograd.grad(
            [kernels.image, kernels.alpha], wanted, [v_image.held, v_alpha.held], allow_unused=True
        )
        gradients = dict(zip(["means2d", *(name for name in ctx.names if name != "Ks")], found, strict=True))
        own = (gradients.get(name) for name in ("means2d", *ctx.names))
        return None, None, *(None if each is None else OnDevice(each) for each in own)


@contextlib.contextmanager
def pretended_gpu(patch: Any) -> Iterator[PretendedGpu]:
    """Pretend a GPU in the block; ``patch`` is pytest's monkeypatch."""
    mode = PretendedGpu()

    def made_here(original: Callable[..., Tensor]) -> Callable[..., Tensor]:
        # On ``meta`` these lose their numbers before the mode sees them.
        def make(*args: Any, device: Any = None, **kwargs: Any) -> Tensor:
            made = original(*args, **kwargs)
            return made if device is None or torch.device(device).type != DEVICE.type else OnDevice(made)

        return make

    for name in ("tensor", "as_tensor"):
        patch.setattr(torch, name, made_here(getattr(torch, name)))
    patch.setattr(
        OnDevice,
        "new_tensor",
        lambda self, data, dtype=None: OnDevice(self.held.new_tensor(data, dtype=dtype)),
        raising=False,
    )
    gsplat, autocast, named = Gsplat(), torch.autocast, api.chosen_backend
    patch.setattr(
        api,
        "chosen_backend",
        lambda name, means: "cuda" if isinstance(means, OnDevice) else named(name, means),
    )
    patch.setattr(cuda, "rasterization", lambda arguments: cuda.render(gsplat, arguments))
    patch.setattr(
        torch,
        "autocast",
        lambda kind, *args, **kwargs: (
            contextlib.nullcontext() if kind == DEVICE.type else autocast(kind, *args, **kwargs)
        ),
    )
    # Tensors of inference mode do not reach a dispatch mode.
    patch.setattr(torch, "inference_mode", torch.no_grad)
    with mode:
        yield mode


@pytest.fixture
def gpu(monkeypatch):
    """The pretended GPU, for the rest of the test; no test may mix its tensors with those of the CPU."""
    with pretended_gpu(monkeypatch) as device:
        yield device
    assert not device.mixed
