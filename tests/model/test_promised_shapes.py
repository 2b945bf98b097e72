"""Every array of every public result has the shape and the kind of numbers that its docstring states, in scenes of all
kinds.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.model.results import CableMotion
from oracles.report_scene import flap

SHAPE = re.compile(r"\(((?:\.\.\.|[A-Za-z]{1,2}(?: \+ 1)?|\d)(?:, (?:[A-Za-z]{1,2}|\d))*),?\)")
ENTRY = re.compile(r"^ {8}(\w+(?:, \w+)*): (.*(?:\n {12}.*)*)", re.MULTILINE)
NAMES = (
    "as it is", "nothing moves", "there and back", "without limits and parts", "tangents and a swivel", "a flat cable",
    "two cables", "a mesh that moves",
)  # fmt: skip
INNER = {"rod"}  # without dimensions, for going on from a shape


def promised(kind: type) -> dict[str, tuple[tuple[str, ...], type]]:
    """Return the axes and the kind of numbers of each array that the docstrings of a class and its bases state."""
    found: dict[str, tuple[tuple[str, ...], type]] = {}
    for one in filter(dataclasses.is_dataclass, kind.__mro__):
        types = {field.name: str(field.type) for field in dataclasses.fields(one)}
        for names, words in ENTRY.findall(one.__doc__ or ""):
            stated = SHAPE.search(words)
            for name in names.split(", "):
                if stated and name in types:
                    numbers = np.int64 if types[name] == "Indices" else np.bool_ if "whether" in words else np.float64
                    found.setdefault(name, (tuple(stated[1].split(", ")), numbers))
    return found


def things(value: object, place: str) -> Iterator[tuple[str, object]]:
    """Give ``value`` and all dataclasses in it that hold results, with where they are."""
    if dataclasses.is_dataclass(value) and not isinstance(value, (ho.Problem, type)):
        yield place, value
        for field in dataclasses.fields(value):
            if not field.name.startswith("_") and field.name not in INNER:
                yield from things(getattr(value, field.name), f"{place}.{field.name}")
    elif isinstance(value, Mapping):
        for name, one in value.items():
            yield from things(one, f"{place}[{name!r}]")
    elif isinstance(value, (tuple, list)):
        for number, one in enumerate(value):
            yield from things(one, f"{place}[{number}]")


def check(result: object, frames: int | None) -> int:
    """Check all arrays in ``result``, of so many frames, and return how many there are."""
    count = 0
    for place, thing in things(result, type(result).__name__):
        sizes, stated = {} if frames is None else {"P": frames}, promised(type(thing))
        for field in dataclasses.fields(thing):
            array = getattr(thing, field.name)
            if field.name.startswith("_") or field.name in INNER or not isinstance(array, np.ndarray):
                continue
            assert field.name in stated, f"{place}.{field.name}: its docstring states no shape"
            axes, numbers = stated[field.name]
            if axes[0] == "...":
                axes = (*(("P",) if isinstance(thing, CableMotion) else ()), *axes[1:])
            assert array.ndim == len(axes), f"{place}.{field.name}: {array.shape}, stated {axes}"
            for size, axis in zip(array.shape, axes, strict=True):
                wanted = int(axis) if axis.isdigit() else sizes.setdefault(axis, size)
                assert size == wanted, f"{place}.{field.name}: {array.shape}, stated {axes}, {sizes}"
            assert array.dtype == numbers, f"{place}.{field.name}: {array.dtype}"
            count += 1
    return count


def scenes(folder) -> dict[str, ho.Problem]:
    run = flap().cables["lead"]
    tangents = dataclasses.replace(
        run,
        start=ho.End((0, 0, 0), tangent=(0, 0, 1)),
        end=ho.End((0.15, 0.02, 0), tangent=(0, 0, -1), roll="free", body="flap"),
    )
    flat = dataclasses.replace(run, cable=dataclasses.replace(run.cable, bending_stiffness=(2e-3, 4e-3)))
    beside = dataclasses.replace(
        run, start=ho.End((0, 0.1, 0), (1, 0, 0, 0)), end=ho.End((0.15, 0.12, 0), (0, 0, 1, 0), body="flap")
    )
    trimesh.creation.box((0.02, 0.02, 0.02)).export(folder / "box.stl")
    mesh = ho.Part(ho.MeshFile(folder / "box.stl", "m"), position=(0.08, 0, 0))
    return {
        "as it is": flap(),
        "nothing moves": flap(bodies={"flap": ho.Body()}),
        "there and back": flap(out_and_back=True),
        "without limits and parts": flap(limits=ho.Limits(), parts={}),
        "tangents and a swivel": flap(cables={"lead": tangents}),
        "a flat cable": flap(cables={"lead": flat}),
        "two cables": flap(cables={"lead": run, "beside": beside}),
        "a mesh that moves": flap(parts={"box": dataclasses.replace(mesh, body="flap")}),
    }


@pytest.fixture(scope="module")
def problems(tmp_path_factory) -> dict[str, ho.Problem]:
    return scenes(tmp_path_factory.mktemp("meshes"))


@pytest.mark.parametrize("name", NAMES)
def test_motions_and_clearances(problems, name):
    problem = problems[name]
    moved = ho.simulate(problem)
    frames = len(moved.motion)
    assert frames == 1 if name == "nothing moves" else frames > 3
    assert check(moved, frames) == 1 + 11 * len(problem.cables)
    measured = ho.clearances(moved)
    assert check(measured, frames) == 1 + 18 * len(measured.pairs)


@pytest.mark.parametrize(
    "spoilt",
    [
        {"position": np.zeros((3, 5, 2))}, {"stable": np.zeros(3)}, {"force": np.zeros((2, 101, 3))},
        {"s": np.zeros(4)}, {"moment": np.zeros((3, 101, 3), dtype=np.float32)},
    ],
)  # fmt: skip
def test_the_check_sees_what_is_wrong(problems, spoilt):
    moved = ho.simulate(problems["as it is"], frames=[0.0, 0.5, 1.0])
    wrong = dataclasses.replace(moved.cables["lead"], **spoilt)
    with pytest.raises(AssertionError, match=r"Motion\.cables"):
        check(dataclasses.replace(moved, cables={"lead": wrong}), 3)


@pytest.mark.parametrize("transcription", ["collocation", "dqm"])
def test_shapes(problems, transcription):
    run = problems["as it is"].cables["lead"]
    ends = run.start, dataclasses.replace(run.end, body="world")
    shape = ho.equilibrium(run.cable, *ends, transcription=transcription)
    assert check(shape, None) == 6
    for several in (np.linspace(0.0, 0.3, 7), [0.1]):
        there = shape.at(several)
        n = len(several)
        assert {name: array.shape for name, array in vars(there).items()} == {
            "s": (n,), "quaternion": (n, 4),
            **{name: (n, 3) for name in ("position", "curvature", "force", "moment")},
        }  # fmt: skip
        assert {array.dtype for array in vars(there).values()} == {np.dtype(np.float64)}


def test_redesigns(problems):
    design = ho.Design(variables=(ho.Variable("lead.length", 0.25, 0.45),))
    found = ho.redesign(dataclasses.replace(problems["as it is"], design=design))
    assert check(found.motion, len(found.motion.motion)) and check(found.clearances, len(found.motion.motion))
    assert check(found.motion_before, len(found.motion_before.motion)) == 12


def test_data_of_the_paper(problems):
    moved = ho.simulate(problems["as it is"], frames=np.linspace(0.0, 1.0, 5))
    profiles = ho.profiles(moved, "lead")
    assert len(profiles) == 5 and all(check(profile, None) == 2 for profile in profiles)
    times, shown = ho.display(moved, "lead", 0.1)
    assert times.shape == (len(shown),) and times.dtype == np.float64
    assert all(check(profile, None) == 2 for profile in shown)


def test_files_hold_the_same(problems, tmp_path):
    moved = ho.simulate(problems["two cables"], frames=[0.0, 0.5, 1.0])
    ho.write_results(moved, tmp_path / "R")
    with np.load(tmp_path / "R" / "motion.npz", allow_pickle=False) as stored:
        assert stored["motion"].shape == (3,)
        for name, shapes in moved.cables.items():
            for key, axes in (("s", ()), ("position", (3,)), ("quaternion", (4,)), ("curvature", (3,)), ("force", (3,)),
                              ("moment", (3,))):  # fmt: skip
                wanted = (len(shapes.s),) if key == "s" else (3, len(shapes.s), *axes)
                assert stored[f"{name}/{key}"].shape == wanted and stored[f"{name}/{key}"].dtype == np.float64
