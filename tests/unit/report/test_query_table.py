"""Answers in aligned columns."""

from egosplat.report.query_command import answers_table


def test_a_refusal_does_not_widen_a_column():
    lines = answers_table(
        ("query", "score", "level", "frame"),
        [
            ("cup", "0.91", "whole", "12"),
            ("elephant", "0.30", "not found: a long reason"),
            ("", "0.60", "part", "3"),
        ],
    ).splitlines()
    assert lines == [
        "query     score  level  frame",
        "cup       0.91   whole  12",
        "elephant  0.30   not found: a long reason",
        "          0.60   part   3",
    ]
