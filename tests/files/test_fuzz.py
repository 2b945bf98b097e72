"""Spoilt files of all kinds: every run ends with an exit code and words; as many as a test has time for.

``scripts/checks/fuzz.py`` makes the inputs and says what has to hold; it tries 20,000.
"""

from __future__ import annotations

import copy
import random
import tempfile
import tomllib
from pathlib import Path

import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oracles.scripts import script

fuzz, fuzz_inputs = script("fuzz"), script("fuzz_inputs")
INPUTS = 500


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    made = fuzz.Inputs()
    made.result = fuzz.result_of(made.problems[-1], tmp_path_factory.mktemp("base"))
    return made


@pytest.mark.slow
def test_spoilt_files_end_in_words(inputs, monkeypatch):
    monkeypatch.setattr(fuzz, "TIME_LIMIT", "0.3")
    codes: set[int | None] = set()
    for number in range(INPUTS):
        with tempfile.TemporaryDirectory() as folder:
            command, file = inputs.make(number, Path(folder))
            outcome = fuzz.tried(command, file, Path(folder))
        assert not outcome.wrong, f"python scripts/checks/fuzz.py --seed {number} --inputs 1: {outcome.wrong}"
        codes.add(outcome.code)
    assert {0, 2} <= codes  # neither all of them broken, nor none


def test_what_is_wrong_is_noticed(inputs, tmp_path, monkeypatch):
    """The judge itself: an escaped error, a wrong code, silence and half a result are all told."""
    fuzz_inputs.put(inputs.problems[-1].contents, tmp_path)
    file = inputs.problems[-1].file

    def judged(main: object) -> str:
        monkeypatch.setattr("harness_opt.cli.commands.main", main)
        return " ".join(fuzz.tried("check", file, tmp_path).wrong)

    assert judged(lambda _: 1 / 0).startswith("escaped: ")
    assert judged(lambda _: 7) == "exit code 7"
    assert judged(lambda _: 2) == "nothing said"
    (tmp_path / "results" / ".flap.1.part").mkdir(parents=True)
    assert judged(lambda _: 0) == "left behind: .flap.1.part"


def test_the_same_number_is_the_same_input(inputs, tmp_path):
    for number in range(20):
        made = [inputs.make(number, tmp_path / side / str(number)) for side in "ab"]
        assert made[0] == made[1]
        files = [{f.name: f.read_bytes() for f in (tmp_path / side / str(number)).rglob("*.toml")} for side in "ab"]
        assert files[0] == files[1]


# --- any value anywhere ---------------------------------------------------------------------------------

TABLES = tomllib.loads(fuzz_inputs.SMALL.replace("SUFFIX", "stl"))
scalars = st.integers() | st.floats() | st.booleans() | st.text(max_size=8)
values = st.recursive(scalars, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=6), inner))


def places(tree: dict, before: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Return the paths of all keys of a tree of tables."""
    found = [(*before, key) for key in tree]
    return found + [p for key, item in tree.items() if isinstance(item, dict) for p in places(item, (*before, key))]


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("small")
    fuzz_inputs.put(fuzz_inputs.small("stl", False).contents, folder)
    return folder


@pytest.mark.slow
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(place=st.sampled_from(places(TABLES)), value=values, name=st.none() | st.text(max_size=8))
def test_any_value_in_any_place(small, place, value, name):
    tables = copy.deepcopy(TABLES)
    table = tables
    for key in place[:-1]:
        table = table[key]
    del table[place[-1]]
    table[place[-1] if name is None else name] = value
    try:
        text = tomlkit.dumps(tables)
        tomllib.loads(text)
    except ValueError:  # what no TOML file can hold
        return
    (small / "small.toml").write_text(text, encoding="utf-8")
    outcome = fuzz.tried("check", "small.toml", small)
    assert not outcome.wrong


def test_bytes_are_spoilt_everywhere():
    """The mutator reaches the beginning, the middle and the end, and changes lengths."""
    content = bytes(range(256)) * 4
    spoilt = [fuzz_inputs.spoilt_bytes(content, random.Random(seed)) for seed in range(400)]
    first = [
        next((k for k, (a, b) in enumerate(zip(content, s, strict=False)) if a != b), len(content)) for s in spoilt
    ]
    assert min(first) < 20 and max(first) > 900
    assert any(len(s) < len(content) for s in spoilt) and any(len(s) > len(content) for s in spoilt)
