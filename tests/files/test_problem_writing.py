"""Problem files that are written: they read back the same, from wherever they stand."""

from __future__ import annotations

import dataclasses
import math
import os
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem, write_problem
from harness_opt.model.bodies import Body, Hinge, Slide
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Design, Limits, Variable
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, Capsule, Cylinder, Part, Sphere
from harness_opt.model.problem import Problem
from oracles.problem_files import CONTRACT, HEADER, ROWS, changed, poses_of, same, with_poses, written


def test_written_file_reads_back_from_another_folder(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    target = write_problem(problem, folder / "deep" / "er" / "better.toml")
    text = target.read_text()
    assert 'mesh = "../../meshes/housing.stl"' in text
    assert 'file = "../../arm.csv"' in text
    again = read_problem(target)
    assert same(again, problem)
    assert again.file == target
    assert sorted(p.name for p in target.parent.iterdir()) == ["better.toml"], "nothing left beside"
    assert write_problem(again, target).read_text() == text


def test_typed_degrees_stay_as_typed(folder: Path) -> None:
    problem = read_problem(written(folder, changed(("to_deg = 110", "to_deg = -112.3"))))
    tables = tomllib.loads(write_problem(problem, folder / "b.toml").read_text())
    assert tables["bodies"]["arm"]["motion"]["to_deg"] == -112.3
    assert tables["limits"]["twist_deg_per_m"] == 360


def test_poses_without_a_file_are_written_beside(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    poses = dataclasses.replace(poses_of(problem), file=None)
    problem = dataclasses.replace(problem, bodies={"arm": Body(poses)})
    again = read_problem(write_problem(problem, folder / "out" / "b.toml"))
    assert again.bodies["arm"].motion == dataclasses.replace(poses, file=folder.resolve() / "out" / "b_arm.csv")


def test_changed_poses_do_not_point_to_their_old_file(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    poses = dataclasses.replace(poses_of(problem), times=(0.0, 1.0, 2.0, 4.0))
    again = read_problem(write_problem(dataclasses.replace(problem, bodies={"arm": Body(poses)}), folder / "b.toml"))
    assert again.bodies["arm"].motion == dataclasses.replace(poses, file=folder.resolve() / "b_arm.csv")
    assert (folder / "arm.csv").read_text() == HEADER + "\n".join(ROWS)


def test_what_could_not_be_read_back_is_not_written(folder: Path) -> None:
    problem = read_problem(written(folder, CONTRACT)).changed(limits=Limits(clearance=math.nan))
    with pytest.raises(ProblemError, match=r"b\.toml: limits\.clearance: found nan"):
        write_problem(problem, folder / "new" / "b.toml")
    assert not (folder / "new").exists()


def test_nowhere_to_write(folder: Path) -> None:
    problem = read_problem(written(folder, CONTRACT))
    with pytest.raises(ProblemError, match="found a folder, expected the name of a file"):
        write_problem(problem, folder)
    with pytest.raises(ProblemError, match="found no way to write"):
        write_problem(problem, folder / "lift.toml" / "b.toml")


def test_a_failed_write_leaves_the_old_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = written(folder, CONTRACT)
    problem = read_problem(file)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(ProblemError, match="No space left on device"):
        write_problem(problem, file)
    assert file.read_text() == CONTRACT
    assert not list(folder.glob(".*"))


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_links_of_folders(folder: Path) -> None:
    real = folder / "real" / "deep"
    real.mkdir(parents=True)
    (folder / "link").symlink_to(real)
    problem = read_problem(written(folder, CONTRACT))
    write_problem(problem, folder / "link" / "b.toml")
    assert same(read_problem(folder / "link" / "b.toml"), problem)
    assert same(read_problem(real / "b.toml"), problem)


finite = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
vectors = st.tuples(finite, finite, finite)
directions = vectors.filter(lambda v: math.hypot(*v) > 1e-3)
names = st.text("abcXYZ_-09é ", min_size=1, max_size=6).filter(lambda name: name == name.strip() and name != "world")
quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple((np.array(q) / math.hypot(*q)).tolist()))
)
optional = lambda strategy: st.none() | strategy  # noqa: E731

cables = st.builds(
    Cable,
    length=st.just(1e8),  # longer than any distance drawn here
    diameter=positive,
    bending_stiffness=positive | st.tuples(positive, positive),
    torsional_stiffness=positive,
    mass_per_length=st.just(0.0) | positive,
    rest_curvature=vectors,
)
motions = optional(
    st.builds(Hinge, vectors, directions, st.floats(-7, 7), st.floats(-7, 7))
    | st.builds(Slide, directions, finite, finite)
)
parts = st.builds(
    Part,
    shape=st.builds(Box, st.tuples(positive, positive, positive))
    | st.builds(Sphere, positive)
    | st.builds(Cylinder, positive, positive)
    | st.builds(Capsule, positive, positive),
    position=vectors,
    quaternion=quaternions,
    clearance=optional(st.just(0.0) | positive),
)


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    stands = st.sampled_from([(0.0, 0.0, 0.0), (0.1, 0.0, -0.3)])
    placed = st.builds(Body, motions, position=stands, quaternion=st.just((1.0, 0.0, 0.0, 0.0)) | quaternions)
    bodies = draw(st.dictionaries(names, placed, max_size=2))
    if len(bodies) == 2 and draw(st.booleans()):
        carried, carrying = bodies
        bodies[carried] = dataclasses.replace(bodies[carried], parent=carrying)
    body = st.sampled_from(["world", *bodies])
    clamps = st.builds(End, position=vectors, quaternion=quaternions, body=body)
    loads = st.builds(End, force=optional(vectors), moment=optional(vectors))
    turned = st.builds(dataclasses.replace, clamps, turns=st.integers(-3, 3))
    runs = st.builds(CableRun, cables, clamps, turned | loads, optional(directions))
    lead = draw(names)
    bounds = draw(st.tuples(positive, positive).filter(lambda b: b[0] < b[1]))
    variables = tuple(
        Variable(f"{lead}.{key}", *bounds) for key in ("length", "start.position.x", "start.rotate_y_deg")
    )
    return Problem(
        cables={lead: draw(runs), **draw(st.dictionaries(names.filter(lambda n: n != lead), runs, max_size=1))},
        bodies=bodies,
        parts=draw(st.dictionaries(names, parts, max_size=2)),
        gravity=draw(vectors),
        limits=draw(
            st.builds(Limits, optional(positive), st.none(), st.none(), optional(positive), optional(positive))
        ),
        design=Design(draw(st.sampled_from(["change", "length"])), variables),
        duration=draw(positive),
        out_and_back=draw(st.booleans()),
        spatial_step=draw(optional(positive)),
        title=draw(st.text(max_size=12)),
    )


def near(problem: Problem) -> Problem:
    """Return ``problem`` with angles rounded to what degrees keep, 1e-12 rad."""
    bodies = {
        name: dataclasses.replace(
            b, motion=dataclasses.replace(b.motion, start=round(b.motion.start, 12), stop=round(b.motion.stop, 12))
        )
        if isinstance(b.motion, Hinge)
        else b
        for name, b in problem.bodies.items()
    }
    return dataclasses.replace(problem, bodies=bodies)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(problem=problems())
def test_round_trip(tmp_path: Path, problem: Problem) -> None:
    again = read_problem(write_problem(problem, tmp_path / "p.toml"))
    assert same(near(again), near(problem))
    # angles that have been degrees once stay the same to the last bit
    third = read_problem(write_problem(again, tmp_path / "q.toml"))
    assert same(third, again)
