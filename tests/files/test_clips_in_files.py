"""Clips in problem files: read, written, varied in studies, and every mistake about them by its key."""

from __future__ import annotations

import dataclasses
import re

import pytest

import harness_opt as ho
from harness_opt.files.quantities import quantities_of
from harness_opt.files.read import read_problem, write_problem
from harness_opt.model.checks import coupling
from oracles.clipped import arm


@pytest.fixture
def file(tmp_path):
    """Return the written problem with two clips."""
    return write_problem(arm(), tmp_path / "arm.toml")


def test_a_written_problem_reads_back(file):
    again = read_problem(file)
    assert again.cables == arm().cables
    assert again.limits == arm().limits
    text = file.read_text(encoding="utf-8")
    assert text.count("[[cables.lead.clips]]") == 2


def test_kinds_are_read_and_written(file, tmp_path):
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('name = "elbow"', 'name = "elbow"\nkind = "fixed"'), encoding="utf-8")
    assert read_problem(file).cables == arm().cables
    for kind in ("swivel", "pivot", "sleeve", "ring"):
        changed = f'name = "elbow"\nkind = "{kind}"\noptional = true'
        file.write_text(text.replace('name = "elbow"', changed), encoding="utf-8")
        elbow = read_problem(file).cables["lead"].clips[0]
        assert (elbow.kind, elbow.optional, elbow.roll) == (kind, True, None)
        again = read_problem(write_problem(read_problem(file), tmp_path / "again.toml"))
        assert again.cables == read_problem(file).cables


WRONG = [
    ('name = "elbow"', 'name = "length"', 'clips.length.name: found "length", expected another name than start, end'),
    ('name = "elbow"', 'name = "wrist"', 'clips.0.name: found "wrist", expected a name of its own'),
    ('name = "elbow"', 'name = "a.b"', 'clips."a.b".name: found the name "a.b", expected a name of letters'),
    ('name = "elbow"', "", "clips.0.name: found nothing, expected text in quotes"),
    ("at = 0.15", "at = 0.5", 'clips.wrist.at: found 0.42, expected more than 0.5, where clip "elbow" is'),
    ("at = 0.15", "at = -1", "clips.elbow.at: found -1, expected a number above 0"),
    ("at = 0.15", "", "clips.elbow.at: found nothing, expected a number above 0"),
    ("length = 0.66", "length = 0.4", "length: found 0.4, expected more than 0.42, where its last clip is"),
    ("at = 0.42", "at = 0.5", "length: found 0.16 from wrist to end, expected at least 0.21"),
    ('body = "arm"\nposition', 'body = "amr"\nposition', 'clips.wrist.body: found "amr", expected one of'),
    ("position = [0.0, 0.04, 0.23]", "force = [0, 0, 1]", "clips.elbow.force: found a force at a clip"),
    ("position = [0.0, 0.04, 0.23]", "", "clips.elbow.position: found nothing, expected [x, y, z]"),
    ("tangent = [0.3, 0.0, 1.0]", "", "clips.elbow.tangent: found nothing, expected [x, y, z]"),
    ("tangent = [0.3, 0.0, 1.0]", "tangent = [0, 0]", "clips.elbow.tangent: found [0, 0], expected [x, y, z]"),
    ("tangent = [0.3", 'roll = "free"\ntangent = [0.3', 'clips.elbow.roll: found "free" at a clip, expected'),
    ("tangent = [0.3", "turns = 0.5\nroll_deg = 3\ntangent = [0.3", "clips.elbow.turns: found 0.5, expected a whole"),
    ("tangent = [0.3", "colour = 3\ntangent = [0.3", "clips.elbow.colour: found an unknown key, expected one of"),
    ('name = "elbow"', 'name = "elbow"\nkind = "slevee"', 'clips.elbow.kind: found "slevee", expected one of'),
    ('name = "elbow"', 'name = "elbow"\nkind = "ring"\nturns = 1', "clips.elbow.turns: found it at a ring, expected"),
    ("tangent = [0.3", 'kind = "swivel"\nroll_deg = 3\ntangent = [0.3', "clips.elbow.roll_deg: found it at a swivel"),
    ("tangent = [0.3", 'holders = ["pots"]\ntangent = [0.3', 'clips.elbow.holders: found "pots", expected a part of'),
]


@pytest.mark.parametrize(("given", "typed", "words"), WRONG, ids=[f"{typed} {words[:24]}" for _, typed, words in WRONG])
def test_mistakes_are_named_by_their_keys(file, given, typed, words):
    text = file.read_text(encoding="utf-8")
    assert given in text
    file.write_text(text.replace(given, typed, 1), encoding="utf-8")
    with pytest.raises(ho.ProblemError) as caught:
        read_problem(file)
    assert any(f"cables.lead.{words}" in line for line in caught.value.mistakes), caught.value.mistakes


def wrong_in_python() -> dict[str, tuple]:
    """Return clips that cannot be, by what is said of them."""
    elbow, wrist = arm().cables["lead"].clips
    return {
        'cables.lead.clips.0.name: found "wrist", expected a name of its own': (
            dataclasses.replace(elbow, name="wrist"),
            wrist,
        ),
        'cables.lead.clips.wrist.at: found 0.42, expected more than 0.5, where clip "elbow" is': (
            dataclasses.replace(elbow, at=0.5),
            wrist,
        ),
        'cables.lead.clips.elbow.body: found "amr", expected': (dataclasses.replace(elbow, body="amr"), wrist),
        "cables.lead.length: found 0.66, expected more than 0.7, where its last clip is": (
            elbow,
            dataclasses.replace(wrist, at=0.7),
        ),
    }


@pytest.mark.parametrize("words", wrong_in_python())
def test_a_problem_in_python_says_the_same(words):
    clips = wrong_in_python()[words]
    run = dataclasses.replace(arm().cables["lead"], clips=clips)
    with pytest.raises(ho.ProblemError) as caught:
        arm(cables={"lead": run})
    assert any(line.startswith(words) for line in caught.value.mistakes), caught.value.mistakes


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "end"}, "name: found 'end'"),
        ({"at": 0.0}, "at: found 0"),
        ({"moment": (0, 0, 1)}, "moment: found it at a clip"),
        ({"roll": "free"}, "roll: found 'free' at a clip"),
    ],
)
def test_a_clip_checks_itself(changes, words):
    with pytest.raises(ho.ProblemError, match=re.escape(words)):
        ho.Clip(**{"name": "elbow", "at": 0.1, "position": (0, 0, 0), "tangent": (0, 0, 1), **changes})


def test_a_clip_is_varied_by_its_name(file):
    quantities = quantities_of(file)
    changed = quantities.problem(
        {"cables.lead.elbow.at": 0.16, "cables.lead.wrist.position.x": 0.11, "cables.lead.elbow.rotate_z_deg": 90.0}
    )
    elbow, wrist = changed.cables["lead"].clips
    assert (elbow.at, elbow.turns) == (0.16, 0.25)
    assert wrist.position == (0.11, 0.04, 0.4)
    assert quantities.problem({}).cables == arm().cables


def test_what_follows_may_be_a_clip():
    assert coupling("= 0.5 * lead.length") == ("lead.length", 0.5, 0.0)
    assert coupling("= -lead.elbow.at + 0.2") == ("lead.elbow.at", -1.0, 0.2)


def test_a_clip_can_follow_the_length(file):
    text = file.read_text(encoding="utf-8")
    text += '\n[design.variables]\n"lead.length" = [0.6, 0.8]\n"lead.wrist.at" = "= 0.6 * lead.length"\n'
    file.write_text(text, encoding="utf-8")
    assert read_problem(file).design.couplings == (ho.Coupling("lead.wrist.at", "lead.length", 0.6),)


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        (
            '"lead.elbow.at" = [0.44, 0.5]',
            "cables.lead.clips.wrist.at: found 0.42 in the design, expected more than 0.44, where clip elbow is",
        ),
        (
            '"lead.length" = [0.3, 0.4]',
            "cables.lead.length: found 0.4 in the design, expected more than 0.42, where clip wrist is",
        ),
    ],
)
def test_bounds_that_put_clips_into_another_order_are_told_by_their_keys(file, variables, words):
    text = file.read_text(encoding="utf-8") + f"\n[design.variables]\n{variables}\n"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ho.ProblemError, match=re.escape(words)):
        ho.redesign(read_problem(file))
