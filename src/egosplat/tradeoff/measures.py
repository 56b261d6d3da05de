"""What is measured of a point, in which unit it is told, and which way is better."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """One measure.

    Attributes:
        name: in files.
        heading: in words.
        unit: in which it is told.
        scale: from the unit in files to that one.
        decimals: that are told.
        more_is_better: whether it is a gain; else it is a cost.
        about: what it is.
    """

    name: str
    heading: str
    unit: str
    scale: float
    decimals: int
    more_is_better: bool
    about: str

    def told(self, value: float | None) -> str:
        """A value in words, ``-`` where there is none."""
        return "-" if value is None else f"{value * self.scale:.{self.decimals}f}"


WALL = Measure(
    "wall_s", "time", "min", 1 / 60, 1, False, "of all stages that make the scene, one after the other"
)
CPU = Measure("cpu_s", "CPU time", "min", 1 / 60, 1, False, "time on processors, of all threads")
MEMORY = Measure("peak_memory_mb", "memory", "MiB", 1.0, 0, False, "the largest of all stages")
DISK = Measure("disk_mb", "disk", "MiB", 1.0, 0, False, "of all artifacts")
ACCURACY = Measure("accuracy", "accuracy", "%", 100.0, 1, True, "share of queries found at their place")
MEAN_IOU = Measure("mean_iou", "mIoU", "%", 100.0, 1, True, "of all queries")
PSNR = Measure("psnr", "static PSNR", "dB", 1.0, 2, True, "of what stays, in held-out frames")

COSTS = (WALL, CPU, MEMORY, DISK)
GAINS = (ACCURACY, MEAN_IOU, PSNR)
MEASURES = (*COSTS, *GAINS)
