"""Tables of results: ranks, averages with intervals, the paper's numbers and its layout."""

from itertools import product
from pathlib import Path

import pytest

from egosplat.evaluation.intervals import clustered_interval
from egosplat.evaluation.queries import GROUPS
from egosplat.evaluation.scores import CHANCE
from egosplat_rivals.scored_scenes import Cell, ScoredScene
from egosplat_rivals.tables.paper_numbers import METHODS, METRICS, SCENES, printed_numbers
from egosplat_rivals.tables.paper_tables import average, paper_tables
from egosplat_rivals.tables.table import PRINTED, SYNTHETIC, Row, number, ranks

TABLE_OF = {"accuracy": "adt_accuracy", "mean_iou": "adt_iou"}


def row(*cells: Cell, kind: str = PRINTED, method: str = "a", readout: str = "") -> Row:
    return Row(kind, "block", method, method, "ADT", (), cells, readout=readout)


def test_numbers_are_formatted_as_the_paper_formats_them():
    texts = {35.9: "35.9", 0.0: "0.0", 100.0: "100.0", 12.349: "12.3", 9.96: "10.0", None: "-"}
    assert {value: number(value) for value in texts} == texts


def test_the_numbers_of_the_paper_agree_with_each_other_but_where_a_note_says_so():
    printed, tables = printed_numbers(), {table.name: table for table in paper_tables([])}
    assert list(tables) == ["adt_accuracy", "adt_iou", "adt_ablation", "hoi4d", "adt_transient"]
    for table, *key in product(("adt_ablation", "adt_transient"), METRICS, GROUPS):
        place, line = ("average", "full") if table == "adt_ablation" else ("scene1", "refined")
        assert printed[table, place, line, *key] == printed[TABLE_OF[key[0]], place, "EgoSplat", *key]
    for metric, name in TABLE_OF.items():
        noted = {
            (row.method, group)
            for row in tables[name].rows[:6]
            for (scene, _, group), mark in zip(tables[name].columns, row.marks, strict=True)
            if scene == "average" and mark
        }
        for method, group in product(METHODS, GROUPS):
            numbers = [printed[name, scene, method, metric, group] for scene in (*SCENES["adt"], "average")]
            assert (abs(sum(numbers[:5]) / 5 - numbers[5]) > 0.1) == ((method, group) in noted)


def test_tables_are_laid_out_as_the_papers_with_its_best_marked():
    accuracy, _, ablation, hoi4d, _ = paper_tables([])
    over = [f"scene {one}" for one in range(1, 6)] + ["avg"]
    assert list(accuracy.headings) == [*product(over, ("St.", "Dy.", "All"))]
    assert [row.method for row in accuracy.rows[:6]] == list(METHODS)
    assert [rank[-2] for rank in ranks(accuracy.rows[:6])] == [0, 0, 0, 2, 0, 1]
    assert [title for title, _ in ablation.headings] == ["Acc (%)"] * 3 + ["mIoU (%)"] * 3
    assert [row.steps for row in ablation.rows[:3]] == [(False, False), (True, False), (True, True)]
    assert hoi4d.headings == (("", "Acc"), ("", "mIoU"))


def test_notes_are_attached_to_their_cells():
    table = paper_tables([])[0]
    texts = {note.mark: note.text for note in table.notes if note.mark}
    lerf, *_, own = table.rows[:6]
    assert "below both 29.7 and 13.0" in texts[lerf.marks[2]]
    assert "Below LangSplat and GAGS" in texts[own.marks[10]]
    assert {mark for one in table.rows[:6] for mark in one.marks} == {"", *texts}


SCENES_OF = [Cell(50.0, scenes=("scene1",)), Cell(40.0, scenes=("scene1", "scene2"))]


@pytest.mark.parametrize(
    "rows, expected",
    [
        ([row(Cell(29.4)), row(Cell(29.41)), row(Cell(28.3)), row(Cell())], [1, 1, 2, 0]),
        ([row(Cell(50.0))], [0]),
        ([row(one) for one in SCENES_OF], [0, 0]),
        ([row(Cell(value), readout="pixels" * (value < 50)) for value in (40, 60, 30, 50)], [1, 1, 2, 2]),
        ([row(Cell(50.0)), row(Cell(40.0)), row(Cell(99.0), method=CHANCE["random_pixel"])], [1, 2, 0]),
        ([row(Cell(50.0), kind=SYNTHETIC), row(Cell(40.0), kind=SYNTHETIC)], [0, 0]),
    ],
)
def test_equal_numbers_share_a_rank_and_what_cannot_be_compared_has_none(rows, expected):
    assert ranks(rows) == [[rank] for rank in expected]


def scored(name: str, hits: dict[str, list[bool]], chance: float | None = 0.05) -> ScoredScene:
    rows = [
        {"frame": frame, "category": category, "groups": {"all": {"hit": hit, "iou": 0.5 * hit}}}
        for category, own in hits.items()
        for frame, hit in enumerate(own)
    ]
    document = {"queries": rows, "scores": {"all": {"random_pixel": chance}}}
    return ScoredScene(Path(name), "adt", name, "full", None, (), document)


@pytest.fixture
def three_scenes() -> dict[str, ScoredScene]:
    """40 % of 80 queries, none asked, and 60 % of 20."""
    first = {f"thing {n}": [n < 8] * 4 for n in range(20)}
    last = {f"thing {n}": [n < 6] * 2 for n in range(10)}
    scenes = [scored("scene1", first), scored("scene2", {}, None), scored("scene3", last, 0.15)]
    return {one.scene: one for one in scenes}


def test_an_average_is_over_the_scenes_that_are_there_and_its_interval_over_their_categories(three_scenes):
    found = average(three_scenes, "accuracy", "all")
    assert found.percent == pytest.approx(50.0)
    assert (found.queries, found.categories, found.scenes) == (100, 30, ("scene1", "scene3"))
    assert average(three_scenes, "mean_iou", "all").percent == pytest.approx(25.0)
    assert average(three_scenes, "accuracy", "static") == Cell()
    clusters = [three_scenes[name].clusters("accuracy", "all") for name in found.scenes]
    expected = clustered_interval(clusters)
    assert found.interval == (100 * expected[0], 100 * expected[1])
    single = {"scene1": scored("scene1", {"cup": [True, False]})}
    assert average(single, "accuracy", "all").interval is None
    chance = average(three_scenes, "random_pixel", "all")
    assert chance.percent == pytest.approx(10.0) and chance.scenes == found.scenes
