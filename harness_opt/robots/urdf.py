"""What a URDF says of a robot: links with their shapes, and the joints between them, as plain data.

Read by yourdfpy, which is imported for the first robot. Lengths are metres, angles radians; an origin turns by roll,
pitch and yaw about fixed axes (http://wiki.ros.org/urdf/XML).
"""

from __future__ import annotations

import importlib.util
import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.checks import Quaternion, Vector, one_of, shown
from harness_opt.model.parts import Box, Cylinder, Solid, Sphere
from harness_opt.numerics import rotations

KINDS = ("fixed", "revolute", "continuous", "prismatic")  # of joints that are understood
MOST_LINKS = 1000
LONGEST = 200  # characters of what the reader says
PLACED_AT_ORIGIN: tuple[Vector, Quaternion] = ((0.0, 0.0, 0.0), rotations.IDENTITY)


@dataclass(frozen=True)
class Shape:
    """One solid of a link.

    Args:
        solid: a primitive, or None.
        mesh: what the URDF calls the file of a mesh; empty for a primitive.
        scale: of the mesh.
        position, quaternion: in the link.
    """

    solid: Solid | None
    mesh: str
    scale: Vector
    position: Vector
    quaternion: Quaternion


@dataclass(frozen=True)
class Joint:
    """What joins a link to the one that carries it.

    Args:
        name: of the joint.
        kind: one of KINDS.
        parent, child: links.
        position, quaternion: of the child in the parent where the joint stands at 0.
        axis: in the child.
        limits: lower and upper, rad or m; None where there are none.
        follows: a joint that this one mimics, with factor and offset; None for one of its own.
    """

    name: str
    kind: str
    parent: str
    child: str
    position: Vector
    quaternion: Quaternion
    axis: Vector
    limits: tuple[float, float] | None
    follows: tuple[str, float, float] | None


@dataclass(frozen=True)
class Description:
    """A robot.

    Args:
        links: their shapes, by name.
        joints: each behind that which moves its parent.
        root: the link that no joint moves.
    """

    links: Mapping[str, tuple[Shape, ...]]
    joints: tuple[Joint, ...]
    root: str


def description_of(content: bytes, meshes: Literal["collision", "visual"]) -> Description:
    """Return what a URDF says.

    Args:
        content: its bytes.
        meshes: which shapes of its links.

    Raises:
        ProblemError: no yourdfpy; no URDF; links and joints that make no tree; a kind of joint that is not understood.
    """
    if importlib.util.find_spec("yourdfpy") is None:
        raise ProblemError('found no yourdfpy, which reads URDFs, expected it: pip install "harness-opt[robots]"')
    robot = _parsed(content)
    links = [link.name for link in robot.links]
    for names, what in ((links, "link"), ([joint.name for joint in robot.joints], "joint")):
        twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
        if twice is not None:
            raise ProblemError(f"found two {what}s called {shown(twice)}, expected one")
    if not links or len(links) > MOST_LINKS:
        raise ProblemError(f"found {len(links)} links, expected 1 to {MOST_LINKS}")
    root, joints = _tree(links, [_joint(joint) for joint in robot.joints])
    shapes = {
        link.name: tuple(_shape(link.name, one) for one in (link.collisions if meshes == "collision" else link.visuals))
        for link in robot.links
    }
    return Description(shapes, joints, root)


def _parsed(content: bytes) -> Any:
    """Return yourdfpy's robot; nothing is loaded that the URDF names."""
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content:
        raise ProblemError("found a document type or entities, expected a URDF, which has none")
    from lxml import etree
    from yourdfpy import URDF

    logging.getLogger("yourdfpy.urdf").addHandler(logging.NullHandler())
    try:
        etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
        plain = {"build_scene_graph": False, "load_meshes": False, "filename_handler": str}
        return URDF.load(io.BytesIO(content), **plain).robot
    except Exception as error:  # the reader fails in as many ways as there are files
        words = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        raise ProblemError(f"found a file that can't be read ({words}), expected a URDF") from error


def _tree(links: list[str], joints: list[Joint]) -> tuple[str, tuple[Joint, ...]]:
    """Return the root and the joints in order, each behind that of its parent."""
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise ProblemError(
                    f"found joint {shown(joint.name)} at a link {shown(link)}, expected {one_of(links, link)}"
                )
    moved = [joint.child for joint in joints]
    twice = next((link for i, link in enumerate(moved) if link in moved[:i]), None)
    if twice is not None:
        raise ProblemError(f"found two joints that move link {shown(twice)}, expected one")
    roots = [link for link in links if link not in moved]
    if len(roots) != 1:
        some = (
            f"several links that no joint moves ({', '.join(roots[:5])})" if roots else "a joint that moves every link"
        )
        raise ProblemError(f"found {some}, expected one such link")
    ordered: list[Joint] = []
    reached = roots
    while reached:
        ordered += (next_ones := [joint for joint in joints if joint.parent in reached])
        reached = [joint.child for joint in next_ones]
    if len(ordered) < len(joints):
        left = next(joint for joint in joints if joint not in ordered)
        raise ProblemError(f"found joint {shown(left.name)} in a circle, expected a way to {shown(roots[0])}")
    return roots[0], tuple(ordered)


def _joint(joint: Any) -> Joint:
    if joint.type not in KINDS:
        raise ProblemError(f"found joint {shown(joint.name)} of the kind {shown(joint.type)}, expected {one_of(KINDS)}")
    axis = _vector(joint.axis)
    if joint.type != "fixed" and not (np.all(np.isfinite(axis)) and any(axis)):
        raise ProblemError(f"found joint {shown(joint.name)} with the axis {shown(list(axis))}, expected a direction")
    limit, limits = joint.limit, None
    if joint.type in ("revolute", "prismatic") and limit is not None:
        limits = (float(limit.lower or 0.0), float(limit.upper or 0.0))  # 0 is what the format takes them for
    follows = None
    if joint.mimic is not None:
        factor = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
        follows = (str(joint.mimic.joint), factor, float(joint.mimic.offset or 0.0))
    return Joint(
        joint.name, joint.type, str(joint.parent), str(joint.child), *_pose(joint.origin), axis, limits, follows
    )


def _shape(link: str, one: Any) -> Shape:
    geometry, pose = one.geometry, _pose(one.origin)
    if geometry.mesh is not None:
        if not geometry.mesh.filename:
            raise ProblemError(f"link {link}: found a mesh without a file, expected one")
        scale = np.broadcast_to(1.0 if geometry.mesh.scale is None else geometry.mesh.scale, 3)
        return Shape(None, geometry.mesh.filename, _vector(scale), *pose)
    if geometry.box is not None:
        return Shape(Box(_vector(geometry.box.size)), "", (1.0, 1.0, 1.0), *pose)
    if geometry.sphere is not None:
        return Shape(Sphere(geometry.sphere.radius), "", (1.0, 1.0, 1.0), *pose)
    return Shape(Cylinder(geometry.cylinder.radius, geometry.cylinder.length), "", (1.0, 1.0, 1.0), *pose)


def _pose(origin: Any) -> tuple[Vector, Quaternion]:
    if origin is None:
        return PLACED_AT_ORIGIN
    w, x, y, z = rotations.unit(rotations.from_matrix(origin[:3, :3])).tolist()
    return _vector(origin[:3, 3]), (w, x, y, z)


def _vector(values: Any) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
