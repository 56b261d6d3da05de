"""The benchmark of a GPU runs whole on the pretended one, whose kernels are those for the CPU."""

from benchmarks.gpu import __main__ as benchmark
from tests.support.pretended_gpu import DEVICE


def test_agreement_is_measured_on_the_device(gpu, monkeypatch):
    """A benchmark that fails on the first GPU would cost its time."""
    monkeypatch.setattr(benchmark, "SCENES", {"large": (0.2, 0.5)})
    rows = list(benchmark.differences(DEVICE))
    assert len(rows) == 4 and gpu.waits
    for row in rows:
        assert 0 < float(row[2]) < 1e-3 and float(row[4]) < 1e-2, row
    assert "| large |" in benchmark.table(DEVICE)
