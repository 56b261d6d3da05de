"""Which things of a catalog are told rightly."""

from types import SimpleNamespace

import numpy as np

from benchmarks.catalog import __main__ as benchmark
from egosplat.frames.recording import Instance
from egosplat.query.answers import Answer


def test_names_are_right_once_and_parts_and_pieces_of_the_building_count_apart(monkeypatch):
    assert {"sofa", "couch", "settee"} <= benchmark.names_of("couch") and "table" in benchmark.names_of(
        "desk"
    )
    assert {"wall", "window", "carpet"} <= benchmark.names_of("shelter") and "bed" not in benchmark.names_of(
        "cup"
    )
    names, told = ["Sofa_1", "Walls"], ["couch", "sofa", "cushion", "wall", "fridge", "cup"]
    shares = np.array([[9, 0, 1], [9, 0, 1], [9, 0, 1], [0, 9, 0], [0, 9, 0], [0, 0, 9]], float)
    monkeypatch.setattr(benchmark, "annotated_shares", lambda *_: (shares, names))
    named = zip(names, ("couch", "shelter"), strict=True)
    instances = [Instance(1, *one, "static", "object") for one in named]
    scene, evaluation = SimpleNamespace(trained=None, folder=benchmark.Path("a/b")), benchmark.Evaluation
    answers = [Answer(name, "found", 0.9, things=(None,)) for name in told]
    rows = benchmark.judge(answers, scene, evaluation(*[None] * 3, [], instances, *[None] * 4))
    assert [one.verdict for one in rows] == ["right", "again", "part", "building", "wrong", "wrong"]
