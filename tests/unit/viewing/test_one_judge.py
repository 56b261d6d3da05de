"""Terminal, page, server, exports and movie say the same of every word."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from egosplat.errors import UserError
from egosplat.export import movie, rerun_recording
from egosplat.export.gaussians import answer_members
from egosplat.query.command import run
from egosplat.query.finished_scene import open_scene
from egosplat.query.grades import FOUND, GUESS, NOT_FOUND
from egosplat.viewing.command import open_page
from egosplat.viewing.options import PageOptions
from tests.support.page_scene import contents_of

GRADES = (FOUND, GUESS, NOT_FOUND)


def told_in_the_terminal(scene, words, output):
    """The grade of each word, and the frame of each thing that is listed."""
    table, found, word = next(run(scene, words, None, 3, output)), {}, ""
    for line in table.splitlines()[3:]:
        cells = [cell.strip() for cell in line.split("  ") if cell.strip()]
        if cells[0] in words:
            word = cells.pop(0)
            found[word] = (next(one for one in GRADES if cells[0].startswith(one)), [])
        if found[word][0] != NOT_FOUND:
            found[word][1].append(int(cells[-1]))
    return found


def test_every_word_has_one_answer(page_scene, tmp_path, monkeypatch):
    scene = open_scene(page_scene, device="cpu")
    facts, _ = contents_of(page_scene / "scene.html")
    words, baked = facts["words"], facts["answers"]
    judged = scene.ask(*words)
    assert {answer.grade for answer in judged} >= {FOUND, NOT_FOUND} and len(words) > 40
    terminal = told_in_the_terminal(scene, words, tmp_path / "query.png")
    _, served = open_page(page_scene, PageOptions(device="cpu"))
    rerun, shown, picture = SimpleNamespace(Boxes3D=dict), [], [(Image.new("RGB", (8, 8)), 1)]
    monkeypatch.setattr(movie, "_pictures", lambda _, some, side: shown.extend(some) or picture)
    movie.run(scene, words, tmp_path / "x.webp", 64)
    assert {one.phrase for one in shown} == {answer.phrase for answer in judged if answer.things}
    for word, answer, page in zip(words, judged, baked, strict=True):
        frames = [thing.frame for thing in answer.things]
        assert terminal[word] == (answer.grade, frames), word
        assert (page["grade"], page["refusal"]) == (answer.grade, answer.refusal), word
        rated = [(thing.frame, thing.score, thing.probability) for thing in answer.things]
        assert [tuple(map(one.get, ("frame", "score", "probability"))) for one in page["things"]] == rated
        assert served(phrase=word.upper()) == {"answers": [page]}
        [reply] = served(phrase=f"the {word}")["answers"]
        assert (reply["grade"], reply["refusal"]) == (page["grade"], page["refusal"]), word
        assert [one["frame"] for one in reply["things"]] == frames
        # Words that are asked together round differently.
        assert reply["probability"] == pytest.approx(page["probability"], abs=1e-4)
        boxes = rerun_recording._boxes(rerun, answer, scene.grading())
        np.testing.assert_array_equal(boxes["centers"], [thing.center for thing in answer.things])
        asked = f"{word}, {answer.grade}, probability"
        assert boxes["labels"] == [f"{asked} {one.probability:.2f}" for one in answer.things]
        if answer.refusal:
            with pytest.raises(UserError, match=word):
                answer_members(scene, word)
        else:
            np.testing.assert_array_equal(answer_members(scene, word), np.sort(answer.things[0].members))
    lists = "where is my couch, and the zeppelin?", "what is on the wall"
    for phrase in (*lists, "coutch", "cup next to the wall", " "):
        asked = scene.ask(phrase)
        for one, reply in zip(asked, served(phrase=phrase)["answers"], strict=True):
            assert (reply["asked"], reply["grade"], reply["refusal"]) == (one.asked, one.grade, one.refusal)
            assert [thing["score"] for thing in reply["things"]] == [thing.score for thing in one.things]
