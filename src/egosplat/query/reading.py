"""Read questions in words: what is asked for, and what it stands to; the page has the same patterns (docs/look.md#questions)."""

import re
import unicodedata
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace

from egosplat.models.clip import OpenClip
from egosplat.query.text import WORDS, clean_phrase, refuse_phrase, untaught_words

# By name a pattern of Python and JavaScript.
PATTERNS = {name: WORDS[name] for name in ("list", "look", "anything", "anyone", "pairs")} | {
    "lead": rf"^(?:{'|'.join(WORDS['lead'])})[\s,:]+",
    "trail": rf"(?:[\s,]*[?!.…。？！]+|[\s,]+(?:{'|'.join(WORDS['trail'])}))$",
    "relation": rf"(?:^|\s+)(?:(?:{WORDS['verbs']})\s+)*(?:{'|'.join(f'({said})' for said in WORDS['relations'].values())})\s+(?=\S)",
    "quoted": '^["“]([^"“”]+)["”]$',
}


@dataclass(frozen=True)
class Question:
    """What is asked for, empty for anything, and what it stands to, one of ``relations`` in words.yml; questions are equal that ask the same.

    ``typed`` are the words that it was read of, ``refusal`` tells why it cannot be asked.
    """

    phrase: str
    relation: str | None = None
    anchors: tuple["Question", ...] = ()
    typed: str = field(default="", compare=False)
    refusal: str | None = None

    @property
    def is_plain(self) -> bool:
        """Whether it asks for one thing, wherever that stands."""
        return bool(self.phrase and not self.relation and not self.refusal)

    @property
    def read(self) -> str:
        """What is asked, such as "cup on table"."""
        anchors = " and ".join(anchor.read for anchor in self.anchors)
        return " ".join(filter(None, (self.phrase or "anything", self.relation, anchors)))

    @property
    def said(self) -> str:
        """What is asked with articles, such as "a cup on an armchair"."""
        return " ".join(filter(None, (with_article(self.phrase), self.stand)))

    @property
    def stand(self) -> str:
        """How it stands to what, such as "on an armchair"; empty if it is asked anywhere."""
        return " ".join(filter(None, (self.relation, " and ".join(anchor.said for anchor in self.anchors))))


def read_questions(clip: OpenClip, text: str, names: Collection[str] = ()) -> list[Question]:
    """Read a text as the questions that it asks, one or more; fixed ``names``, and what is in quotation marks, are asked as typed."""
    typed, blank = clean_phrase(text), Question("", refusal=refuse_phrase(clip, ""))
    if typed.lower() in names or _search("quoted", typed):
        return [replace(_read(clip, typed, names), typed=typed)]
    plain = unicodedata.normalize("NFKC", typed)
    parts = list(_split(strip_asking(plain)))
    questions = [_read(clip, part, names) for part in parts] or [blank]
    if parts == [plain] and questions[0].phrase in (plain, "") and not questions[0].relation:
        questions = [Question(typed, refusal=refuse_phrase(clip, typed))]
    for row in range(len(questions) - 1, 0, -1):
        # "Cup and book on the table": both.
        if f"{parts[row - 1]} and {parts[row]}" in typed and not questions[row - 1].relation:
            how = {"relation": questions[row].relation, "anchors": questions[row].anchors}
            questions[row - 1] = replace(questions[row - 1], **how)
    return [replace(question, typed=typed) for question in questions]


def _split(text: str) -> Iterator[str]:
    """Split a list into its parts, but neither "between a and b" nor "black and white"."""
    held = re.sub(r"(\bbetween\b.+?)\s+and\s+", "\\1 \0 ", text, flags=re.IGNORECASE)
    before = ""
    for part in filter(None, re.split(PATTERNS["list"], held, flags=re.IGNORECASE)):
        if _search("look", part):
            before += f"{part} and "
            continue
        yield before + part
        before = ""
    if before:
        yield before.removesuffix(" and ")


def _read(clip: OpenClip, text: str, names: Collection[str]) -> Question:
    """Read one question, with what it stands to."""
    if quoted := _search("quoted", text):
        return Question(quoted[1], refusal=refuse_phrase(clip, quoted[1]))
    thing = text if text.lower() in names else strip_asking(text)
    known = isinstance(clip.words, frozenset) and not untaught_words(clip, thing)
    if known or thing.lower() in names or (said := _search("relation", thing)) is None:
        return _asked(clip, thing)
    relation = [*WORDS["relations"]][(said.lastindex or 1) - 1]
    rest = thing[said.end() :]
    # "On the table between a and b": both are for the table.
    others = map(str.strip, rest.split("\0") if relation == "between" else [rest])
    anchors = tuple(replace(one := _read(clip, part, names), phrase=one.phrase or part) for part in others)
    refusal = next((anchor.refusal for anchor in anchors if anchor.refusal), None)
    if all(_search("look", anchor.phrase) for anchor in anchors):
        return _asked(clip, thing)
    phrase = strip_asking(thing[: said.start()])
    asked = _asked(clip, phrase) if phrase else Question("")
    return replace(asked, relation=relation, anchors=anchors, refusal=asked.refusal or refusal)


def strip_asking(text: str) -> str:
    """A phrase without what asks for it; as it is if nothing else is left."""
    before, rest = "", text.strip()
    while rest != before:
        before = rest
        rest = re.sub(PATTERNS["trail"], "", rest, flags=re.IGNORECASE) or rest
        if rest == before:
            rest = re.sub(PATTERNS["lead"], "", rest, flags=re.IGNORECASE) or rest
    return rest


def _search(name: str, text: str) -> re.Match[str] | None:
    return re.search(PATTERNS[name], text, re.IGNORECASE)


def _asked(clip: OpenClip, phrase: str) -> Question:
    """A question for a thing, by a singular that the model was taught where it was not taught the plural."""
    if _search("anything", phrase):
        return Question("")
    if _search("anyone", phrase):
        phrase = "person"
    for word in untaught_words(clip, phrase) if isinstance(clip.words, frozenset) else ():
        singulars = (re.sub(end, own, word) for end, own in WORDS["plurals"] if re.search(end, word))
        singular = next((one for one in singulars if not untaught_words(clip, one)), word)
        if singular != word and not _search("pairs", word):
            phrase = re.sub(rf"\b{re.escape(word)}\b", singular, phrase, flags=re.IGNORECASE)
    return Question(phrase, refusal=refuse_phrase(clip, phrase))


def with_article(phrase: str) -> str:
    """A phrase behind its article: "an armchair", "scissors"."""
    if phrase.endswith("s") and not phrase.endswith("ss"):
        return phrase
    return f"{'an' if phrase[:1].lower() in set('aeiou') else 'a'} {phrase}" if phrase else "anything"
