"""Centrelines in STEP: what is read back is the cable, in another program's geometry too."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.interpolate import BSpline

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.pictures import export as exports
from harness_opt.pictures.step import centreline
from oracles.report_scene import flap

ENTITY = re.compile(r"^#(\d+)=(\w*)\((.*)\);$", re.MULTILINE)


def curves(text: str) -> list[BSpline]:
    """Return the B-splines of a STEP file, read as ISO 10303-21 and 10303-42 have them."""
    entities = {int(number): (kind, rest) for number, kind, rest in ENTITY.findall(text)}
    found = []
    for kind, rest in entities.values():
        if kind == "B_SPLINE_CURVE_WITH_KNOTS":
            degree = int(rest.split(",")[1])
            listed, counts, knots = re.findall(r"\(([^()]*)\)", rest)
            points = [
                [float(x) for x in re.findall(r"\(([^()]*)\)", entities[int(number)][1])[0].split(",")]
                for number in re.findall(r"#(\d+)", listed)
            ]
            repeated = np.repeat([float(x) for x in knots.split(",")], [int(x) for x in counts.split(",")])
            found.append(BSpline(repeated, np.array(points), degree))
    return found


@pytest.fixture(scope="module")
def moved() -> ho.Motion:
    return ho.simulate(flap(), frames=[0.0, 0.5, 1.0])


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3)])
def test_curves_are_the_frames(moved, unit, factor):
    shapes, text = moved.cables["lead"], centreline(moved, "lead", unit)
    assert text.startswith("ISO-10303-21;") and text.endswith("END-ISO-10303-21;\n")
    assert ("SI_UNIT(.MILLI.,.METRE.)" in text) == (unit == "mm") and text.isascii()
    found = curves(text)
    assert len(found) == 3
    for frame, curve in enumerate(found):
        at = factor * shapes.s
        assert curve(at) == pytest.approx(factor * shapes.position[frame], abs=1e-12 * factor)
        tangents = rotations.tangent(shapes.quaternion[frame])
        assert curve(at[1:-1], nu=1) == pytest.approx(tangents[1:-1], abs=1e-9), "the parameter is the arc length"


def test_between_the_stations_it_is_the_exact_shape(moved):
    run = moved.problem.cables["lead"]
    ends = (moved.problem.ends("lead", [0.0]))[0]
    shape = ho.equilibrium(run.cable, *ends, gravity=moved.problem.gravity)
    between = np.linspace(0.0, run.cable.length, 1234)
    (curve, *_) = curves(centreline(moved, "lead", "m"))
    assert curve(between) == pytest.approx(shape.at(between).position, abs=1e-6 * run.cable.length)


def test_it_is_exported_with_names_of_any_language(tmp_path):
    problem = flap()
    run = problem.cables["lead"]
    named = ho.simulate(flap(cables={"Kabel ä": run}), frames=[0.0, 1.0])
    ho.write_results(named, tmp_path / "R")
    (told,) = exports.export(tmp_path / "R", "step", tmp_path / "out", "mm")
    assert "in mm, 2 frames, a curve each" in told
    text = (tmp_path / "out" / "Kabel_ä_mm.step").read_text(encoding="ascii")
    assert "'Kabel \\X4\\000000E4\\X0\\'" in text
    references = {int(number) for number in re.findall(r"#(\d+)", text)}
    assert references == {int(number) for number in re.findall(r"^#(\d+)=", text, re.MULTILINE)}


def test_another_program_reads_it(moved, tmp_path):
    """Open CASCADE, where it is installed: too large to be asked for."""
    control = pytest.importorskip("OCP.STEPControl")
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GCPnts import GCPnts_AbscissaPoint
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    (tmp_path / "lead.step").write_text(centreline(moved, "lead", "m"), encoding="ascii")
    reader = control.STEPControl_Reader()
    reader.ReadFile(str(tmp_path / "lead.step"))
    assert reader.TransferRoots() == 1
    edges, lengths = TopExp_Explorer(reader.OneShape(), TopAbs_EDGE), []
    while edges.More():
        lengths.append(GCPnts_AbscissaPoint.Length_s(BRepAdaptor_Curve(TopoDS.Edge(edges.Current()))))
        edges.Next()
    assert lengths == pytest.approx([300.0] * 3, rel=1e-7), "millimetres, as Open CASCADE has them"
