"""Poses of a harness between its frames: as many more are found as the smooth way through them all needs.

Between frames everything free stands where a cubic spline through the found poses says. How far off that is shows where
every other pose is left out: with twice the distance the spline is 16 times as far off (de Boor, "A Practical Guide to
Splines", chapter V).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.harness.balance import State
from harness_opt.harness.following import walked
from harness_opt.model.courses import FoundPoses
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

BETWEEN = 1e-7  # lengths of a span, and rad, by which a pose between frames may be off: as the shapes themselves
LEAST = 5  # poses of a smooth stretch, of which every other one can be left out
ROUNDS = 6  # of more poses: each halves the longest steps


@dataclass(frozen=True)
class Filled:
    """States of a harness, and where their way is not smooth.

    Args:
        states: in the order of the motion.
        jumps: numbers of those that are come to by a jump.
        kinks: numbers of those at which the way turns sharply.
    """

    states: Sequence[State]
    jumps: tuple[int, ...]
    kinks: tuple[int, ...]


def filled(states: Sequence[State], jumps: Sequence[int], turns: Sequence[float]) -> Filled:
    """Return ``states`` with more between them.

    Args:
        states: in the order of the motion.
        jumps: numbers of those that are come to by a jump.
        turns: motion values at which bodies turn round, across which nothing is smooth.
    """
    found, at, kinks = list[State](), list[int](), list[int]()
    edges = [0, *jumps, len(states)]
    for first, last in itertools.pairwise(edges):
        at += [len(found)] if found else []
        pieces = _parted(list(states[first:last]), turns)
        for number, piece in enumerate(pieces):
            whole = _stretch(piece)
            if number:
                kinks.append(len(found) - 1)
                del whole[0]
            found += whole
    return Filled(found, tuple(at), tuple(kinks))


def _parted(states: list[State], turns: Sequence[float]) -> list[list[State]]:
    """Return a stretch cut where bodies turn round, both pieces with the state there, which is found if it is none."""
    pieces = [states]
    for turn in turns:
        last = pieces[-1]
        before = sum(state.at < turn for state in last)
        if not 0 < before < len(last):
            continue
        here = last[before] if last[before].at == turn else walked([last[before - 1]], turn)
        if here is not None:
            beyond = [state for state in last[before:] if state.at > turn]
            pieces[-1:] = [[*last[:before], here], [here, *beyond]]
    return pieces


def _stretch(states: list[State]) -> list[State]:
    """Return the states of a smooth stretch with as many more as it needs; fewer where one is not found."""
    for _ in range(ROUNDS):
        if len(states) < 2:
            break
        wanted = _rough(states)
        if not wanted:
            break
        for k in reversed(wanted):
            around = [states[j] for j in (k - 1, k + 2, k + 1, k) if 0 <= j < len(states)]
            between = walked(around, 0.5 * (states[k].at + states[k + 1].at))
            if between is not None:
                states.insert(k + 1, between)
    return states


def _rough(states: Sequence[State]) -> list[int]:
    """Return the intervals between states in which the spline through them is too far off."""
    if len(states) < LEAST:
        return list(range(len(states) - 1))
    motion = np.array([state.at for state in states])
    off = np.zeros(len(states))
    for found, scale in _ways(states, motion):
        for begin in (1, 2):  # the odd ones left out, then the even ones
            kept = np.union1d(np.arange(begin - 1, len(states), 2), [0, len(states) - 1])
            left = np.setdiff1d(np.arange(len(states)), kept)
            some = FoundPoses(
                motion[kept], found.positions[kept], found.quaternions[kept],
                places=None if found.places is None else found.places[kept],
            )  # fmt: skip
            position, quaternion = some.poses(motion[left])
            miss = np.linalg.norm(position - found.positions[left], axis=1) / scale
            turn = rotations.multiply(rotations.conjugate(quaternion), found.quaternions[left])
            miss = np.maximum(miss, np.linalg.norm(rotations.small_rotation_vector(turn), axis=1))
            if found.places is not None:
                miss = np.maximum(miss, np.abs(some.arc_lengths(motion[left]) - found.places[left]) / scale)
            off[left] = np.maximum(off[left], miss / 16.0)
    rough = np.maximum(off[1:], off[:-1]) > BETWEEN
    return np.flatnonzero(rough).tolist()


def _ways(states: Sequence[State], motion: Array) -> list[tuple[FoundPoses, float]]:
    """Return the ways of everything free, each with the length that its places are compared to, m."""
    harness = states[0].harness
    found = harness.freedoms.found(motion, [state.pose for state in states])
    return [(way, harness.length) for way in found.values()]
