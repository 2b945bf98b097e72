"""A robot's links as bodies, one on the other, and their shapes as parts; what its joints do is told by a program.

A joint at value v takes its child to ``T0 exp(v a)`` in its parent: T0 where it stands at 0, a its axis in the child.
That is a hinge or a slide of the parent, about the axis turned by T0, which carries what stands at T0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.bodies import Body, Hinge, Slide
from harness_opt.model.checks import one_of, shown
from harness_opt.model.courses import ValueTable
from harness_opt.model.parts import MeshFile, Part
from harness_opt.numerics import rotations
from harness_opt.robots.urdf import Description, Joint, Shape

ROUNDING = 1e-9  # of a limit, rad or m: a program that stops at its limit is not beyond it
NO_UNIT = (".stl", ".obj", ".ply")  # of a mesh, which a URDF takes for metres


@dataclass(frozen=True)
class Program:
    """What the joints do.

    Args:
        times: (n,), s.
        values: (n,) of each joint that has a column, by name, rad or m.
    """

    times: tuple[float, ...]
    values: Mapping[str, tuple[float, ...]]


def program_mistakes(described: Description, names: list[str]) -> Iterator[str]:
    """Yield what is wrong about the joints that a program names."""
    own = {joint.name: joint for joint in described.joints if joint.kind != "fixed" and joint.follows is None}
    joints = {joint.name: joint for joint in described.joints}
    for name in names:
        if name in own:
            continue
        found = f"found joint {shown(name)}"
        if name in joints:
            follows = joints[name].follows
            found += ", which is fixed" if follows is None else f", which mimics {shown(follows[0])}"
        else:
            found += ", which the URDF lacks"
        yield f"{found}, expected {one_of(own, name) if own else 'none: no joint moves'}"


def bodies_of(name: str, described: Description, base: Body, program: Program | None) -> dict[str, Body]:
    """Return the links of the robot called ``name`` as bodies ``name.LINK``, its root on ``base``.

    Raises:
        ProblemError: a joint that mimics one that is not there, or itself.
    """
    found = {f"{name}.{described.root}": base}
    for joint in described.joints:
        parent = f"{name}.{joint.parent}"
        found[f"{name}.{joint.child}"] = _moved(joint, course_of(joint, described, program), parent)
    return found


def course_of(joint: Joint, described: Description, program: Program | None) -> ValueTable | float:
    """Return what a joint does, rad or m: a course, or one value; 0 where the program does not tell.

    Raises:
        ProblemError: as :func:`bodies_of`.
    """
    factor, offset, seen = 1.0, 0.0, [joint.name]
    joints = {one.name: one for one in described.joints}
    while joint.follows is not None:
        followed, more, shift = joint.follows
        if followed not in joints or followed in seen:
            words = "itself" if followed in seen else f"{shown(followed)}, which the URDF lacks"
            raise ProblemError(
                f"found joint {shown(joint.name)} that mimics {words}, expected {one_of(joints, followed)}"
            )
        factor, offset = factor * more, factor * shift + offset
        joint = joints[followed]
        seen.append(followed)
    values = None if program is None else program.values.get(joint.name)
    if program is None or values is None:
        return offset
    told = tuple(factor * value + offset for value in values)
    return ValueTable(program.times, told) if max(told) > min(told) else told[0]


def _moved(joint: Joint, course: ValueTable | float, parent: str) -> Body:
    q = np.asarray(joint.quaternion)
    if joint.kind == "fixed":
        return Body(None, parent, joint.position, joint.quaternion)
    axis = rotations.normalise(np.asarray(joint.axis))
    carried: tuple[float, float, float] = tuple(rotations.rotate(q, axis).tolist())
    if isinstance(course, ValueTable):
        if joint.kind == "prismatic":
            return Body(Slide(carried, follows=course), parent, joint.position, joint.quaternion)
        return Body(Hinge(joint.position, carried, follows=course), parent, joint.position, joint.quaternion)
    if not course:
        return Body(None, parent, joint.position, joint.quaternion)
    if joint.kind == "prismatic":
        return Body(None, parent, tuple((joint.position + course * np.asarray(carried)).tolist()), joint.quaternion)
    turned = rotations.unit(rotations.multiply(q, rotations.from_rotation_vector(course * axis)))
    return Body(None, parent, joint.position, tuple(turned.tolist()))


def shapes_of(
    name: str, described: Description, leave_out: Sequence[str]
) -> tuple[dict[str, tuple[str, Shape]], list[str]]:
    """Return the link and the shape of each part ``name.LINK``, or ``name.LINK.1`` and on, and mistakes.

    Args:
        name, described: the robot.
        leave_out: parts, or links with all of theirs, that are not wanted.
    """
    found = {
        f"{name}.{link}" if len(shapes) == 1 else f"{name}.{link}.{number}": (link, shape)
        for link, shapes in described.links.items()
        for number, shape in enumerate(shapes, 1)
    }
    known = list(dict.fromkeys([*(f"{name}.{link}" for link in described.links), *found]))
    wrong = [f"found {shown(one)}, expected {one_of(known, one)}" for one in leave_out if one not in known]
    unwanted = set(leave_out)
    return {key: one for key, one in found.items() if not {key, f"{name}.{one[0]}"} & unwanted}, wrong


def part_of(name: str, link: str, shape: Shape, file: Path | None, shell: bool) -> Part:
    """Return a shape of a link as a part; ``file`` is that of a mesh, ``shell`` whether one that is open will do."""
    solid = shape.solid
    if file is not None:
        unit = "m" if file.suffix.lower() in NO_UNIT else None
        return Part(MeshFile(file, unit, shell, scale=shape.scale), f"{name}.{link}", shape.position, shape.quaternion)
    if solid is None:
        raise ProblemError(f"link {link}: found a mesh without a file, expected one")
    return Part(solid, f"{name}.{link}", shape.position, shape.quaternion)


def limit_warnings(described: Description, program: Program | None) -> Iterator[str]:
    """Yield the joints that leave their limits, or stand beyond them, and curves that leave the rows of the program."""
    for joint in described.joints:
        course = course_of(joint, described, program)
        low, high = course.range if isinstance(course, ValueTable) else (course, course)
        unit, factor = ("m", 1.0) if joint.kind == "prismatic" else ("deg", math.degrees(1.0))
        if joint.kind == "fixed":
            continue
        found = f"found joint {joint.name}"
        if joint.limits is not None and (low < joint.limits[0] - ROUNDING or high > joint.limits[1] + ROUNDING):
            at = (
                f"from {factor * low:.5g} to {factor * high:.5g} {unit}"
                if low < high
                else f"at {factor * low:.5g} {unit}"
            )
            lower, upper = (factor * limit for limit in joint.limits)
            yield f"{found} {at}, beyond its limits {lower:.5g} and {upper:.5g} {unit}"
        if isinstance(course, ValueTable) and course.beyond > 0.01 * (high - low):
            far = f"{factor * course.beyond:.3g} {unit}"
            yield f"{found} {far} beyond the program's values, between rows that are far apart; give more rows"
