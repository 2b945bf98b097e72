"""Centrelines for CAD: a STEP file of cubic B-splines, a curve for each frame, as AP 214 has them.

A centreline is the cubic Hermite through its stations: positions and tangents are those of the result, the parameter is
the arc length. As a B-spline (de Boor, A Practical Guide to Splines, chapter IX) it has knots at the stations, twice
each and four times at the ends, and two control points for each station, a third of the neighbouring intervals before
and after it along its tangent; at the ends, the station and one.
"""

from __future__ import annotations

import datetime

import numpy as np

from harness_opt.model.results import Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.pictures.dxf import UNITS, layer_names

PREFIXES = {"m": "$", "mm": ".MILLI."}
EXACT = 1e-8  # m: points nearer than this are one
HEAD = """\
ISO-10303-21;
HEADER;
FILE_DESCRIPTION(('centreline of a cable, a curve for each frame'),'2;1');
FILE_NAME({name},'{time}',(''),(''),'','harness-opt','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN {{ 1 0 10303 214 1 1 1 1 }}'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('core data for automotive mechanical design processes');
#2=APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#1);
#3=PRODUCT_CONTEXT('',#1,'mechanical');
#4=PRODUCT({name},{name},'',(#3));
#5=PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,(#4));
#6=PRODUCT_DEFINITION_FORMATION('','',#4);
#7=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#8=PRODUCT_DEFINITION('design','',#6,#7);
#9=PRODUCT_DEFINITION_SHAPE('','',#8);
#10=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({prefix},.METRE.));
#11=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#12=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#13=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE({exact:E}),#10,'distance_accuracy_value','');
#14=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#13))\
GLOBAL_UNIT_ASSIGNED_CONTEXT((#10,#11,#12))REPRESENTATION_CONTEXT('',''));
#15=CARTESIAN_POINT('',(0.,0.,0.));
#16=DIRECTION('',(0.,0.,1.));
#17=DIRECTION('',(1.,0.,0.));
#18=AXIS2_PLACEMENT_3D('',#15,#16,#17);
#19=SHAPE_DEFINITION_REPRESENTATION(#9,#20);
"""
FIRST = 21  # number that is free behind them


def centreline(motion: Motion, name: str, unit: str) -> str:
    """Return the STEP text of a cable's centreline in every frame.

    Args:
        motion: with at least one frame.
        name: of the cable.
        unit: "m" or "mm".
    """
    factor, shapes = UNITS[unit][1], motion.cables[name]
    time = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    head = HEAD.format(name=_text(name), time=time, prefix=PREFIXES[unit], exact=factor * EXACT)
    lines, sets, number = list[str](), list[int](), FIRST
    knots = ",".join(_real(factor * s) for s in shapes.s)
    counts = ",".join(["4", *["2"] * (len(shapes.s) - 2), "4"])
    tangents = rotations.tangent(shapes.quaternion)
    for label, position, tangent in zip(layer_names(motion), shapes.position, tangents, strict=True):
        points = factor * control_points(shapes.s, position, tangent)
        lines += [f"#{number + k}=CARTESIAN_POINT('',({','.join(map(_real, p))}));" for k, p in enumerate(points)]
        listed = ",".join(f"#{number + k}" for k in range(len(points)))
        curve, number = number + len(points), number + len(points) + 2
        kind = f"B_SPLINE_CURVE_WITH_KNOTS('{label}',3,({listed}),.UNSPECIFIED.,.F.,.F.,({counts}),({knots})"
        lines += [f"#{curve}={kind},.UNSPECIFIED.);", f"#{curve + 1}=GEOMETRIC_CURVE_SET('{label}',(#{curve}));"]
        sets.append(curve + 1)
    items = ",".join(f"#{one}" for one in (18, *sets))
    whole = f"#20=GEOMETRICALLY_BOUNDED_WIREFRAME_SHAPE_REPRESENTATION({_text(name)},({items}),#14);"
    return head + "\n".join([whole, *lines]) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def control_points(s: Array, position: Array, tangent: Array) -> Array:
    """Return the control points (2 N, 3), m, of the cubic through stations ``s`` (N,) at ``position``, ``tangent``."""
    third = np.diff(s)[:, None] / 3.0
    before, after = position[1:] - third * tangent[1:], position[:-1] + third * tangent[:-1]
    inner = np.stack([after, before], axis=1).reshape(-1, 3)
    return np.concatenate([position[:1], inner, position[-1:]])


def _real(value: float) -> str:
    """Return a number as STEP has it: with a point."""
    return f"{float(value):.15E}"


def _text(words: str) -> str:
    """Return a string as STEP has it: quotes doubled, and letters beyond ASCII by their UCS-4 numbers."""
    told = words.replace("\\", "\\\\").replace("'", "''")
    return "'" + "".join(c if " " <= c <= "~" else f"\\X4\\{ord(c):08X}\\X0\\" for c in told) + "'"
