"""What commands make of bodies that carry bodies: words, pages, exports, and a redesign that reads back."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from oracles.chains import PAN_TILT
from oracles.flap import PLAIN, put

HIT = PAN_TILT.replace("[limits]", '[design.variables]\n"lead.length" = [0.29, 0.5]\n[limits]').replace(
    "[0.04, 0.03, 0.03]", "[0.02, 0.02, 0.02]"
)


def test_check_says_what_carries_what(here, capsys):
    assert main(["check", put(PAN_TILT)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Body pan: turns about" in told
    assert "Body tilt, on pan: turns about the axis (0, 1, 0) through the point (0, 0, 150) mm" in told
    assert "Body lamp, on tilt: is fixed." in told


def test_the_preview_draws_axes_on_what_carries_them(here, capsys):
    assert main(["preview", put(PAN_TILT), "-o", "p.html"]) == 0
    page = Path("p.html").read_text()
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])
    scene = data["scenes"][0]
    axes = [[end["body"] for end in line["ends"]] for line in scene["lines"] if line["colour"] is None]
    assert axes == [["world", "world"], ["pan", "pan"]]
    assert set(scene["bodies"]) == {"world", "pan", "tilt", "lamp"}
    assert {part["name"]: part["moves"] for part in data["parts"]} == {"mast": True, "head": True}


def test_a_redesigned_chain_reads_back_and_holds(here, capsys):
    assert main(["redesign", put(HIT), "-o", "out", *PLAIN]) == 0
    again = ho.read_problem("out/redesigned.toml")
    assert {name: body.parent for name, body in again.bodies.items()} == {"pan": "world", "tilt": "pan", "lamp": "tilt"}
    assert main(["simulate", "out/redesigned.toml", "-o", "again", *PLAIN]) == 0
    used = ho.read_problem("out/used/redesigned.toml")
    at = np.linspace(0, 1, 5)
    for one, other in zip(used.poses("lamp", at), again.poses("lamp", at), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_carried_part_moves_in_exports(here, capsys):
    main(["simulate", put(PAN_TILT), "-o", "out", *PLAIN])
    assert main(["export", "out", "--to", "gltf", "-o", "gltf"]) == 0
    file = Path("gltf/motion.glb").read_bytes()
    tree = json.loads(file[20 : 20 + int.from_bytes(file[12:16], "little")])
    moving = {tree["nodes"][channel["target"]["node"]]["name"] for channel in tree["animations"][0]["channels"]}
    assert {"pan", "lamp"} <= moving


@pytest.mark.parametrize("parent", ["lamp", "tlit"])
def test_a_parent_that_cannot_be_is_bad_input(here, capsys, parent):
    assert main(["check", put(PAN_TILT.replace('parent = "pan"', f'parent = "{parent}"'))]) == 2
    error = capsys.readouterr().err
    assert "bodies.tilt.parent: found " in error or "bodies.lamp.parent: found " in error
