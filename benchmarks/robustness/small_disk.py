"""A small disk to fill: a file system in memory whose size can change while it is used."""

import shutil
import subprocess
from pathlib import Path
from typing import Self

ROOMY_BYTES = 2**30


class NoMountError(Exception):
    """This process may not mount a file system."""


class SmallDisk:
    """A file system of its own at ``folder``, inside the block.

    Raises:
        NoMountError: without the right to mount; `unshare --user --map-root-user --mount COMMAND` gives it to a command.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._mount("-t", "tmpfs", "-o", f"size={ROOMY_BYTES}", "tmpfs")
        return self

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", "--lazy", self.folder], check=True)

    def leave(self, room: int) -> None:
        """Shrink the disk so that ``room`` bytes are left on it."""
        self._mount("-o", f"remount,size={shutil.disk_usage(self.folder).used + room}")

    def enlarge(self) -> None:
        """Give it room again."""
        self._mount("-o", f"remount,size={ROOMY_BYTES}")

    def freeze(self) -> None:
        """Make it read-only."""
        self._mount("-o", "remount,ro")

    def _mount(self, *options: str) -> None:
        done = subprocess.run(["mount", *options, self.folder], capture_output=True, text=True, check=False)
        if done.returncode:
            raise NoMountError(done.stderr.strip())
