"""What pyproject.toml cannot say: the kernels are compiled here.

They are plain shared libraries, not extension modules: they know nothing of Python, so one wheel serves all
versions of Python 3.
"""

import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parent
KERNELS = "egosplat/kernels"

sys.path.insert(0, str(ROOT / "src"))

from egosplat.kernels.compiling import compile_kernels
from egosplat.kernels.variants import VARIANTS


class BuildKernels(build_ext):
    """Compile the kernels beside the wrappers that load them."""

    def run(self) -> None:
        for note in compile_kernels(ROOT / "src" / KERNELS, self._folder()):
            print(note, file=sys.stderr)

    def get_outputs(self) -> list[str]:
        return [str(path) for variant in VARIANTS if (path := self._folder() / variant.file).is_file()]

    def get_output_mapping(self) -> dict[str, str]:
        return {}

    def _folder(self) -> Path:
        return (ROOT / "src" if self.inplace else Path(self.build_lib)) / KERNELS


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and every Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]


setup(
    ext_modules=[Extension("egosplat.kernels.library", [f"src/{KERNELS}/source/kernels.cpp"])],
    cmdclass={"build_ext": BuildKernels, "bdist_wheel": PlatformWheel},
)
