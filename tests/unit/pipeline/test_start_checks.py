"""Snakemake asks for the name of the user when it starts."""

import getpass
import os

from egosplat.pipeline.process_guards import name_user


def test_a_user_without_a_name_gets_a_number(monkeypatch):
    def unknown() -> str:
        raise KeyError("getpwuid(): uid not found")

    monkeypatch.setenv("USER", "me")
    name_user()
    assert os.environ["USER"] == "me"
    monkeypatch.setattr(getpass, "getuser", unknown)
    name_user()
    assert os.environ["USER"] == str(os.getuid())
