"""Parts to stay clear of: what a problem describes, as geometry that answers distances of points.

Everything is in the coordinates of the part's body, in metres. Distances are positive outside and negative
inside.

Meshes are read by trimesh and asked through coal. A ball of radius 0 against a BVH of triangles is exact
(1e-16 m measured), and so is a capsule of radius 0 that stays clear of the surface (7e-7 m with coal's own
tolerance, 3e-15 with :data:`GJK`). Thicker capsules are wrong where they penetrate, by 6e-4 m at a radius of
1 mm, or infinite in a triangle's plane: so only centrelines are asked. coal sees a shell without an inside;
the sign is that of the generalised winding number. Both packages are imported when the first mesh is
loaded.

Primitives are closed forms, vectorised. coal 3.0.3 with a ball of radius 0, compared with them at 3,000
points: Box, Sphere and Capsule agree within 1e-15 m outside and inside; Cylinder agrees outside, but inside
it returns the distance to the mantle alone, wrong by up to 79 % of the radius near a cap. It also takes 7
us a point, the closed forms less than 1 us.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import rotations
from .errors import ProblemError
from .problem import Box, Capsule, Cylinder, MeshFile, Part, Problem, Sphere
from .rotations import Array

Distances = tuple[Array, Array, Array]
Faces = NDArray[np.int64]

METRES = {None: 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")
MOST_FACES = 10_000_000
FLAT = (
    1e-9  # height over longest edge below which a triangle has no area: coal returns 0 anywhere on its line
)
AGREE = (
    1e-9  # of the mesh's diagonal: largest difference between coal's answer and the exact one on its triangle
)
GJK = 1e-9  # tolerance of coal's iteration between a segment and a triangle; its own is 1e-6
FEW_FACES = 5_000  # up to here a winding number is summed triangle by triangle
FAR = 2.5  # radii of a cluster beyond which it is a dipole: wrong by 0.03 turns at most where measured
PAIRS = 1_000_000  # point-triangle pairs at a time, so that temporaries stay below 100 MB


def _length(v: Array) -> Array:
    """Return the Euclidean lengths (...) of vectors (..., 3); several times faster than np.linalg.norm."""
    return np.sqrt(np.einsum("...i,...i->...", v, v))


def _dot(u: Array, v: Array) -> Array:
    return np.einsum("...i,...i->...", u, v)


@dataclass(frozen=True, eq=False)
class Geometry:
    """One part in the coordinates of its body.

    Args:
        name, body: as in the problem.
        lower, upper: corners of the box along the body's axes that holds the part, m, (3,).
        closed: False for an open mesh, a shell without an inside, whose distances are never negative.
    """

    name: str
    body: str
    lower: Array
    upper: Array
    closed: bool

    def signed_distance(self, points: ArrayLike) -> Distances:
        """Return distance (n,), gradient (n, 3) and nearest surface point (n, 3) of ``points`` (n, 3), m.

        The gradient is the unit vector along which the distance grows; on the surface the outward normal.
        """
        raise NotImplementedError

    def lower_bound(self, points: ArrayLike) -> Array:
        """Return numbers (...) that :meth:`signed_distance` of ``points`` (..., 3) is never below, m; cheap.

        The part lies in its box, so its signed distance is at least that of the box, inside the box too.
        """
        half = 0.5 * (self.upper - self.lower)
        beyond = np.abs(np.asarray(points) - 0.5 * (self.upper + self.lower)) - half
        bound = _length(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=-1), 0.0)
        return bound if self.closed else np.maximum(bound, 0.0)

    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """Return numbers (k,) that the signed distance is never below along straight chords, m.

        Args:
            start, end: (k, 3), m.
            at_start, at_end: (k,), bounds below the signed distances there.
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Primitive(Geometry):
    """A box, sphere, cylinder or capsule.

    Args:
        shape: its sizes.
        position, quaternion: its pose in the body.
    """

    shape: Box | Sphere | Cylinder | Capsule
    position: Array
    quaternion: Array

    def signed_distance(self, points: ArrayLike) -> Distances:
        """See :meth:`Geometry.signed_distance`. Formulas: Ericson, Real-Time Collision Detection, 5.1."""
        local = rotations.rotate(rotations.conjugate(self.quaternion), np.asarray(points) - self.position)
        distance, gradient, nearest = _shape_distance(self.shape, local)
        turn = self.quaternion
        return distance, rotations.rotate(turn, gradient), self.position + rotations.rotate(turn, nearest)

    def lower_bound(self, points: ArrayLike) -> Array:
        """Return the distances themselves (...): they are cheap enough."""
        points = np.asarray(points, dtype=float)
        return self.signed_distance(points.reshape(-1, 3))[0].reshape(points.shape[:-1])

    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """See :meth:`Geometry.chord_bound`.

        The signed distance to a convex set is a convex function (Delfour and Zolesio, Shapes and Geometries,
        chapter 7), so it lies above its tangents at both ends of the chord.
        """
        chord = end - start
        (f, g, _), (h, k, _) = self.signed_distance(start), self.signed_distance(end)
        falls, rises = _dot(g, chord), _dot(k, chord)
        between = (falls < 0) & (rises > 0)
        crossing = (h - rises - f) / np.where(between, falls - rises, 1.0)
        lowest = np.maximum(f + falls * crossing, h + rises * (crossing - 1.0))
        return np.where(between, lowest, np.where(falls >= 0, f, h))


@dataclass(frozen=True, eq=False)
class Mesh(Geometry):
    """A triangle mesh.

    Args:
        vertices: (k, 3), m, in the body's coordinates.
        faces: (m, 3), vertex numbers.
        areas: (m, 3), twice the area vectors, as the file turns its faces, m2.
        normals: (m, 3), unit, outward where the mesh is closed.
    """

    vertices: Array
    faces: Faces
    areas: Array
    normals: Array
    query: _CoalQuery = field(repr=False)
    clusters: _Clusters | None = field(repr=False)

    def signed_distance(self, points: ArrayLike) -> Distances:
        """See :meth:`Geometry.signed_distance`."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        diagonal = float(np.linalg.norm(self.upper - self.lower))
        claimed, face = self.query(points)
        nearest = closest_on_triangles(points, *self.vertices[self.faces[face]].swapaxes(0, 1))
        offset = points - nearest
        distance = _length(offset)
        # NaN compares false, so what is not surely right is asked again, of every triangle
        scale = diagonal + distance
        for i in np.flatnonzero(~(np.abs(claimed - distance) <= AGREE * scale)):
            nearest[i], face[i] = self._nearest_of_all(points[i])
            offset[i] = points[i] - nearest[i]
            distance[i] = np.linalg.norm(offset[i])
        sign = self._signs(points, distance)
        touching = distance <= 1e-12 * scale  # too near for the difference to have a direction
        gradient = offset * (sign / np.where(touching, 1.0, distance))[:, None]
        gradient[touching] = self.normals[face[touching]]
        return sign * distance, gradient, nearest

    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """See :meth:`Geometry.chord_bound`.

        Exact for chords that two balls clear of the surface cover, else what follows from the ends alone.
        """
        length = _length(end - start)
        bound = 0.5 * (at_start + at_end - length)
        outside = np.flatnonzero((at_start > 0) & (at_end > 0) & (bound > 0) & (length > 0))
        exact = self.query.chords(start[outside], end[outside])
        highest = np.minimum(at_start, at_end)[outside] + length[outside]  # what is above, or NaN, is absurd
        bound[outside] = np.where((exact > bound[outside]) & (exact <= highest), exact, bound[outside])
        return bound

    def winding_number(self, points: ArrayLike) -> Array:
        """Return the generalised winding numbers (n,) of ``points`` (n, 3): +-1 inside, 0 outside.

        The sum of the triangles' solid angles over 4 pi: Van Oosterom and Strackee, "The solid angle of a
        plane triangle", IEEE Trans. Biomed. Eng. 30 (1983).
        """
        points = np.atleast_2d(np.asarray(points, dtype=float))
        step = max(1, PAIRS // max(1, len(points)))
        parts = (slice(first, first + step) for first in range(0, len(self.faces), step))
        return np.sum([self._turns(points, part) for part in parts], axis=0)

    def _turns(self, points: Array, which: slice | Faces) -> Array:
        """Return the part of the winding numbers (n,) that is due to the faces ``which``."""
        faces = self.faces[which]
        a, b, c = (self.vertices[faces[:, k]] - points[:, None] for k in range(3))
        volume = np.einsum("nmi,mi->nm", a, self.areas[which])
        (la, lb, lc), (ab, bc, ca) = map(_length, (a, b, c)), map(_dot, (a, b, c), (b, c, a))
        return np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2 * np.pi)

    def _holds(self, point: Array) -> bool:
        """Whether ``point`` (3,), off the surface, is inside the closed mesh.

        Large meshes are summed by clusters, the far ones as dipoles: Barill et al., "Fast winding numbers for
        soups and clouds", ACM Trans. Graph. 37 (2018), with one level of clusters. The true number is whole:
        so the sum itself shows whether that was good enough.
        """
        clusters = self.clusters
        if clusters is not None:
            offset = clusters.centre - point
            distance = _length(offset)
            near = distance < FAR * clusters.radius
            dipoles = _dot(clusters.area, offset)[~near] / distance[~near] ** 3
            turns = np.sum(dipoles) / (4 * np.pi)
            faces = [clusters.members[k] for k in np.flatnonzero(near)]
            if faces:
                turns += self._turns(point[None], np.concatenate(faces))[0]
            if abs(turns - round(turns)) < 0.2:
                return round(turns) != 0
        return bool(abs(self.winding_number(point)[0]) > 0.5)

    def _signs(self, points: Array, distance: Array) -> Array:
        """Return +1.0 outside and -1.0 inside (n,) for points at unsigned ``distance`` (n,).

        A ball about an inside point that misses the surface lies in the part, hence in its box: it is no
        larger than half the shortest side. Two points whose balls overlap lie on the same side, so few need a
        winding number.
        """
        sign = np.ones(len(points))
        if not self.closed:
            return sign
        inside_box = np.all((points > self.lower) & (points < self.upper), axis=1)
        unsure = np.flatnonzero(inside_box & (distance <= 0.5 * np.min(self.upper - self.lower)))
        if not len(unsure):
            return sign
        # runs of points that follow each other, each standing for all of its own by its largest ball
        at, ball = points[unsure], distance[unsure]
        parted = _length(np.diff(at, axis=0)) >= ball[1:] + ball[:-1]
        run = np.concatenate([[0], np.cumsum(parted)])
        order = np.lexsort((-ball, run))
        leader = order[np.unique(run[order], return_index=True)[1]]
        at, ball = at[leader], ball[leader]
        side = np.ones(len(leader))
        left = np.argsort(-ball, kind="stable")
        while len(left):
            seed, left = left[0], left[1:]
            side[seed] = -1.0 if self._holds(at[seed]) else 1.0
            queue = deque([seed])
            while queue and len(left):
                i = queue.popleft()
                same = _length(at[left] - at[i]) < ball[left] + ball[i]
                side[left[same]] = side[seed]
                queue.extend(left[same])
                left = left[~same]
        sign[unsure] = side[run]
        return sign

    def _nearest_of_all(self, point: Array) -> tuple[Array, int]:
        """Return the nearest point (3,) on the mesh and its face, by looking at every triangle."""
        best, winner, nearest = math.inf, 0, point
        for first in range(0, len(self.faces), PAIRS):
            corners = self.vertices[self.faces[first : first + PAIRS]].swapaxes(0, 1)
            candidates = closest_on_triangles(np.broadcast_to(point, corners[0].shape), *corners)
            distance = _length(candidates - point)
            k = int(np.argmin(distance))
            if distance[k] < best:
                best, winner, nearest = float(distance[k]), first + k, candidates[k]
        return nearest, winner


@dataclass(frozen=True, eq=False)
class _Clusters:
    """Neighbouring triangles, k times: face numbers, area vectors (k, 3), m2, and balls about them."""

    members: tuple[Faces, ...]
    area: Array
    centre: Array
    radius: Array

    @staticmethod
    def of(corners: Array, areas: Array) -> _Clusters:
        """Split faces (m, 3, 3), (m, 3) at the median along the longest side, into about sqrt(m) clusters."""
        middle = corners.mean(axis=1)
        members = [np.arange(len(areas))]
        for _ in range(round(0.5 * math.log2(len(areas)))):
            along = [middle[group, np.argmax(np.ptp(middle[group], axis=0))] for group in members]
            members = [
                half
                for group, x in zip(members, along, strict=True)
                for half in np.array_split(group[np.argpartition(x, len(x) // 2)], 2)
            ]
        weights = _length(areas)
        centre = np.array([np.average(middle[group], axis=0, weights=weights[group]) for group in members])
        radius = [_length(corners[group] - at).max() for group, at in zip(members, centre, strict=True)]
        area = np.array([0.5 * areas[group].sum(axis=0) for group in members])
        return _Clusters(tuple(members), area, centre, np.array(radius))


class _CoalQuery:
    """Distances of points and segments to a triangle shell; coal's request and result are made once."""

    def __init__(self, vertices: Array, faces: Faces):
        import coal

        self._coal = coal
        self._model = coal.BVHModelOBBRSS()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addVertices(vertices)
        self._model.addTriangles(faces)
        self._model.endModel()
        self._still, self._moved = coal.Transform3s.Identity(), coal.Transform3s.Identity()
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = GJK

    def __call__(self, points: Array) -> tuple[Array, Faces]:
        """Return unsigned distances (n,) of points (n, 3) and nearest faces (n,); NaN and 0 where none."""
        claimed, face = np.empty(len(points)), np.empty(len(points), dtype=np.int64)
        ball, distance, moved, result = self._coal.Sphere(0.0), self._coal.distance, self._moved, self._result
        moved.setRotation(np.eye(3))
        for i, point in enumerate(points):
            moved.setTranslation(point)
            result.clear()
            claimed[i] = distance(ball, moved, self._model, self._still, self._request, result)
            face[i] = result.b1  # coal puts the mesh first, whatever the order of the arguments
        claimed[face < 0] = np.nan
        return claimed, np.maximum(face, 0)

    def chords(self, start: Array, end: Array) -> Array:
        """Return unsigned distances (k,) of segments (k, 3), (k, 3) that do not meet the shell."""
        exact = np.empty(len(start))
        if not len(start):
            return exact
        length = _length(end - start)
        frames = rotations.matrix(rotations.shortest_arc([0.0, 0.0, 1.0], (end - start) / length[:, None]))
        distance, moved, result = self._coal.distance, self._moved, self._result
        for i, middle in enumerate(0.5 * (start + end)):
            needle = self._coal.Capsule(0.0, length[i])
            moved.setRotation(frames[i])
            moved.setTranslation(middle)
            result.clear()
            exact[i] = distance(needle, moved, self._model, self._still, self._request, result)
        return exact


def closest_on_triangles(p: Array, a: Array, b: Array, c: Array) -> Array:
    """Return the point (n, 3) of each triangle ``a, b, c`` (n, 3) that is nearest to ``p`` (n, 3).

    The nearest of the feet on the three edges and, where it falls inside, on the plane. Every candidate is a
    convex combination of the corners, so slivers cannot lead it off the triangle. Ericson, Real-Time
    Collision Detection, 5.1.2 and 5.1.5.
    """
    u, v, w = b - a, c - a, p - a
    uu, uv, vv, wu, wv = (_dot(x, y) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    determinant = uu * vv - uv * uv
    safe = np.where(determinant > 0, determinant, 1.0)
    beta, gamma = (vv * wu - uv * wv) / safe, (uu * wv - uv * wu) / safe
    best = a + beta[:, None] * u + gamma[:, None] * v
    inside = (determinant > 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
    least = np.where(inside, _length(best - p), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        square = _dot(edge, edge)
        along = _dot(p - start, edge) / np.where(square > 0, square, 1.0)
        foot = start + np.clip(along, 0.0, 1.0)[:, None] * edge
        distance = _length(foot - p)
        best = np.where((distance < least)[:, None], foot, best)
        least = np.minimum(least, distance)
    return best


def _shape_distance(shape: Box | Sphere | Cylinder | Capsule, p: Array) -> Distances:
    """Return distance (n,), gradient (n, 3) and nearest point (n, 3), all and ``p`` in the shape's frame."""
    if isinstance(shape, Box):
        return _box_distance(np.abs(shape.size) / 2, p)
    if isinstance(shape, Cylinder):
        # a rectangle in the half plane through the axis and the point
        around = np.hypot(p[:, 0], p[:, 1])
        radial = np.where(
            around[:, None] > 0, p[:, :2] / np.where(around > 0, around, 1.0)[:, None], [1.0, 0.0]
        )
        flat = np.column_stack([around, p[:, 2]])
        distance, gradient, nearest = _box_distance(np.array([shape.radius, shape.length / 2]), flat)
        lift = [np.column_stack([radial * v[:, :1], v[:, 1]]) for v in (gradient, nearest)]
        return distance, lift[0], lift[1]
    half = shape.length / 2 if isinstance(shape, Capsule) else 0.0
    axis = np.column_stack([np.zeros((len(p), 2)), np.clip(p[:, 2], -half, half)])
    offset = p - axis
    length = _length(offset)
    gradient = np.where(
        length[:, None] > 0, offset / np.where(length > 0, length, 1.0)[:, None], [1.0, 0.0, 0.0]
    )
    return length - shape.radius, gradient, axis + shape.radius * gradient


def _box_distance(half: Array, p: Array) -> Distances:
    """The same for a box of half sizes ``half`` (k,) in k dimensions, ``p`` (n, k)."""
    beyond = np.abs(p) - half
    outside = np.any(beyond > 0, axis=1)
    nearest = np.clip(p, -half, half)
    rows, wall = np.arange(len(p)), np.argmax(beyond, axis=1)
    normal = np.zeros_like(p)
    normal[rows, wall] = np.where(p[rows, wall] < 0, -1.0, 1.0)
    nearest[rows, wall] = np.where(outside, nearest[rows, wall], normal[rows, wall] * half[wall])
    offset = p - nearest
    length = np.sqrt(np.sum(offset * offset, axis=1))
    gradient = np.where(outside[:, None], offset / np.where(length > 0, length, 1.0)[:, None], normal)
    return np.where(outside, length, beyond.max(axis=1)), gradient, nearest


@dataclass(frozen=True, eq=False)
class Scene:
    """All parts of a problem.

    Args:
        parts: by name.
        warnings: for the user, one line each: what was found that limits the answers.
    """

    parts: Mapping[str, Geometry] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def load_scene(problem: Problem) -> Scene:
    """Return the parts of ``problem`` as geometry; imports trimesh and coal only where a part is a mesh.

    Raises:
        ProblemError: a mesh that cannot be read, has no triangles, too many, or numbers that are not finite;
            a primitive without size. One line per mistake.
    """
    parts: dict[str, Geometry] = {}
    mistakes: list[str] = []
    for name, part in problem.parts.items():
        try:
            parts[name] = _mesh(name, part) if isinstance(part.shape, MeshFile) else _primitive(name, part)
        except ProblemError as error:
            mistakes += error.mistakes
    if mistakes:
        raise ProblemError(mistakes)
    warnings = tuple(
        f"parts.{name}.mesh: the surface is not closed, so what is inside it goes unnoticed"
        for name, part in parts.items()
        if not part.closed
    )
    return Scene(parts, warnings)


def _primitive(name: str, part: Part) -> Primitive:
    shape = part.shape
    assert not isinstance(shape, MeshFile)
    q, position = np.asarray(part.quaternion, dtype=float), np.asarray(part.position, dtype=float)
    sizes = {"size": shape.size} if isinstance(shape, Box) else dict(vars(shape))
    for key, size in sizes.items():
        numbers = np.atleast_1d(np.asarray(size, dtype=float))
        if not (np.all(np.isfinite(numbers)) and np.all(numbers > 0)):
            kind = type(shape).__name__.lower()
            raise ProblemError(f"parts.{name}.{kind}.{key}: found {size!r}, expected a length above 0 m")
    frame = rotations.matrix(q)
    if isinstance(shape, Box):
        half = np.abs(frame) @ (np.asarray(shape.size) / 2)
    elif isinstance(shape, Cylinder):
        half = np.abs(frame[:, 2]) * shape.length / 2 + shape.radius * np.hypot(frame[:, 0], frame[:, 1])
    else:
        reach = shape.length / 2 if isinstance(shape, Capsule) else 0.0
        half = np.abs(frame[:, 2]) * reach + shape.radius
    return Primitive(name, part.body, position - half, position + half, True, shape, position, q)


def _mesh(name: str, part: Part) -> Mesh:
    assert isinstance(part.shape, MeshFile)
    vertices, faces = _read(f"parts.{name}.mesh", part.shape)
    vertices = part.position + rotations.rotate(part.quaternion, vertices * METRES[part.shape.unit])
    closed, faces = _orient(faces)
    a, b, c = vertices[faces].swapaxes(0, 1)
    areas = np.cross(b - a, c - a)
    longest = np.max([_length(b - a), _length(c - b), _length(a - c)], axis=0)
    solid = _length(areas) > FLAT * longest**2
    if not np.any(solid):
        raise ProblemError(f"parts.{name}.mesh: found only triangles without area, expected a surface")
    # the volume tells whether a closed mesh is inside out
    flip = -1.0 if closed and np.einsum("mi,mi->", a - a[0], np.cross(b - a[0], c - a[0])) < 0 else 1.0
    faces = np.ascontiguousarray(faces[solid])
    used = vertices[np.unique(faces)]
    return Mesh(
        name,
        part.body,
        used.min(axis=0),
        used.max(axis=0),
        closed,
        vertices,
        faces,
        areas[solid],
        flip * rotations.normalise(areas[solid]),
        _CoalQuery(vertices, faces),
        _Clusters.of(vertices[faces], areas[solid]) if closed and len(faces) > FEW_FACES else None,
    )


def _read(key: str, mesh: MeshFile) -> tuple[Array, Faces]:
    """Return the vertices (k, 3), in the file's unit and merged, and the faces (m, 3) of ``mesh``."""
    import trimesh

    if mesh.path.suffix.lower() not in FORMATS:
        raise ProblemError(f"{key}: found {mesh.path.name!r}, expected a file ending in {', '.join(FORMATS)}")
    if mesh.unit not in METRES:
        raise ProblemError(f"{key}_unit: found {mesh.unit!r}, expected one of m, cm, mm, in")
    try:
        loaded: Any = trimesh.load_scene(mesh.path, process=False).to_mesh()
    except Exception as error:  # the readers of foreign files fail in as many ways as there are files
        raise ProblemError(
            f"{key}: found {mesh.path} unreadable ({error}), expected a triangle mesh"
        ) from error
    if len(loaded.faces) == 0:
        raise ProblemError(f"{key}: found no triangles in {mesh.path}, expected a triangle mesh")
    if len(loaded.faces) > MOST_FACES:
        raise ProblemError(f"{key}: found {len(loaded.faces):,} triangles, expected at most {MOST_FACES:,}")
    if not np.all(np.isfinite(loaded.vertices)):
        raise ProblemError(f"{key}: found vertices that are not finite in {mesh.path}, expected numbers")
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return np.array(loaded.vertices, dtype=float), faces[distinct]


def _orient(faces: Faces) -> tuple[bool, Faces]:
    """Return whether ``faces`` (m, 3) close, and the faces, some turned round where that makes them close.

    They close where every edge is run through as often one way as the other: exactly then the winding number
    is whole away from the surface, whether or not an edge belongs to more than two faces.
    """
    if _balanced(faces):
        return True, faces
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Two copies of each face, as it is and turned round; neighbours that agree on their edge join equal
    # copies. A component of this graph is a consistent choice of copies, its mirror image the opposite one.
    count = len(faces)
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner, upward = np.tile(np.arange(count), 3), edges[:, 0] < edges[:, 1]
    _, edge, uses = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    pairs = order[uses[edge[order]] == 2].reshape(-1, 2)
    one, other = owner[pairs].T
    turned = upward[pairs[:, 0]] == upward[pairs[:, 1]]
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * turned, other + count * ~turned])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    flip = label[:count] > label[count:]
    component = np.minimum(label[:count], label[count:])
    # most faces of a component are taken to be right, so that cavities stay cavities
    flip ^= (np.bincount(component, weights=flip) > 0.5 * np.bincount(component))[component]
    repaired = np.where(flip[:, None], faces[:, ::-1], faces)
    return (True, repaired) if _balanced(repaired) else (False, faces)


def _balanced(faces: Faces) -> bool:
    """Whether every edge of ``faces`` is run through as often one way as the other."""
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, index = np.unique(key, return_inverse=True)
    return not np.any(np.bincount(index, weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)))
