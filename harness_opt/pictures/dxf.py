"""Centrelines for CAD: a DXF file of 3-D polylines, a layer for each frame; of Release 12, which all programs read."""

from __future__ import annotations

from collections.abc import Iterator

from harness_opt.model.results import Motion

UNITS = {"m": (6, 1.0), "mm": (4, 1e3)}  # number of $INSUNITS, and how many make a metre
OPEN_3D, VERTEX_3D = 8, 32  # flags of a polyline in space, and of its vertices
COLOUR = 7  # black or white


def centreline(motion: Motion, name: str, unit: str) -> str:
    """Return the DXF text of a cable's centreline in every frame.

    Args:
        motion: with at least one frame.
        name: of the cable.
        unit: "m" or "mm".
    """
    number, factor = UNITS[unit]
    layers = layer_names(motion)
    return "".join(f"{code}\n{value}\n" for code, value in _pairs(motion, name, layers, number, factor))


def layer_names(motion: Motion) -> list[str]:
    """Return the name of each frame's layer: its number, and where the motion stands."""
    moments = motion.problem.moments
    names = []
    for frame, at in enumerate(motion.motion):
        words = moments.short(float(at)).replace(".", "_").replace("-", "minus_").replace(" ", "_")
        names.append(f"frame_{frame:04d}" + (f"_{words}" if words else ""))
    return names


def _pairs(
    motion: Motion, name: str, layers: list[str], number: int, factor: float
) -> Iterator[tuple[int, str | int | float]]:
    """Give the group codes and values of the file."""
    yield from ((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"), (9, "$INSUNITS"), (70, number))
    yield from ((0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(layers)))
    for layer in layers:
        yield from ((0, "LAYER"), (2, layer), (70, 0), (62, COLOUR), (6, "CONTINUOUS"))
    yield from ((0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"))
    for layer, positions in zip(layers, motion.cables[name].line.position, strict=True):
        yield from ((0, "POLYLINE"), (8, layer), (66, 1), (70, OPEN_3D), (10, 0.0), (20, 0.0), (30, 0.0))
        for x, y, z in (factor * positions).tolist():
            yield from ((0, "VERTEX"), (8, layer), (10, x), (20, y), (30, z), (70, VERTEX_3D))
        yield from ((0, "SEQEND"), (8, layer))
    yield from ((0, "ENDSEC"), (0, "EOF"))
