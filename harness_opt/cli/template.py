"""A first problem file to change into one's own: commented, and solved as it stands."""

from __future__ import annotations

import os
from pathlib import Path

import tomlkit

from harness_opt.errors import ProblemError
from harness_opt.files.whole_folder import write_whole

TEMPLATE = """\
# A cable from a wall to a lid that opens. Change it into your own; every key: harness-opt schema
# As it stands two limits are violated; harness-opt redesign finds a length and a clamp that hold them all.
# SI units: metres, newtons, kilograms, seconds. Degrees only in keys that end in _deg.

schema = 1
title = {title}
gravity = [0, 0, -9.81]                  # m/s2; leave it out for a weightless cable

[cables.lead]
length = 0.36                            # m
diameter = 6e-3                          # m
bending_stiffness = 4e-3                 # N m2; [kx, ky] for a flat cable
torsional_stiffness = 3e-3               # N m2; about 0.75 times the bending stiffness where not known
mass_per_length = 0.08                   # kg/m, or density = ... in kg/m3

# Both clamps: the body that holds it, where (m, in that body's coordinates), and which way the cable runs there,
# from the start towards the end on both. Without a tangent it may point anywhere; without a roll it is not twisted.
start = {{ body = "world", position = [0, 0, 0.05], tangent = [0, 0, 1] }}
end = {{ body = "lid", position = [0.18, 0, 0.05], tangent = [0, 0, -1] }}

[bodies.lid.motion]                      # a body moves; the body "world" stands still
kind = "hinge"                           # or "slide", or "poses" from a CSV file
point = [0.3, 0, 0]                      # m, anywhere on the hinge
axis = [0, 1, 0]
from_deg = 0
to_deg = 60

[motion]
duration = 2.0                           # s, for playback
spatial_step = 0.01                      # m, most that a clamp moves between two solved frames

[parts.wall]                             # what to stay clear of; without body it belongs to the world
box = {{ size = [0.1, 0.1, 0.04] }}
position = [0, 0, 0.02]

[parts.panel]
body = "lid"
box = {{ size = [0.2, 0.1, 0.02] }}
position = [0.2, 0, 0.03]
# mesh = "meshes/panel.stl"              # instead of a box; with mesh_unit = "mm"

[limits]                                 # each may be left out
clearance = 0.004                        # m: to parts, to other cables and to itself
bend_radius = 0.03                       # m
twist_deg_per_m = 360
clamp_force = 20                         # N
clamp_moment = 1.0                       # N m

[design]                                 # what harness-opt redesign may change, and within which bounds
minimise = "change"                      # or "length", "clips"

[design.variables]
"lead.length" = [0.30, 0.50]             # m
"lead.end.rotate_y_deg" = [-30, 30]      # degrees, the clamp turned about its d2; check says where that points
"""


def write_template(name: Path) -> Path:
    """Write a problem file called ``name``, with or without ``.toml``, and return it.

    Raises:
        ProblemError: there is one already, or it cannot be written.
    """
    if not name.name:
        raise ProblemError(f"{name}: found no name of a file, expected one such as my_cable")
    file = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    if os.path.lexists(file):
        raise ProblemError(f"{file}: found a file of that name, expected a new one")
    title = file.stem.encode("utf-8", "replace").decode()  # a name may have bytes that are no text
    try:
        write_whole(file, TEMPLATE.format(title=tomlkit.item(title).as_string()).encode())
    except OSError as error:
        raise ProblemError(f"{file}: found no way to write it ({error.strerror or error}), expected one") from error
    return file
