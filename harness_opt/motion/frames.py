"""The solved frames of one cable: the last ones as they were solved, and past a limit of memory the others on disk.

A solve keeps the factorised Jacobian that it ended with, tens of times the memory of its unknowns. Who goes on from a
frame wants it, and a redesign does; of a long motion on a fine mesh there is no room for them all. What goes to disk
are the unknowns, to the last bit, and nothing else: what follows from them is found again when it is asked for. What
does not, the estimated error, which takes the Jacobian that there was, is found before.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from typing import overload

import numpy as np

from harness_opt.motion.rows_on_disk import RowsOnDisk
from harness_opt.numerics.linear import Factor
from harness_opt.numerics.rotations import Array
from harness_opt.rod.states import Rod
from harness_opt.statics.solve import Solved, batch, estimates

MOST_HELD = 200_000_000  # bytes of frames that stay in memory, of all cables of a problem together
NODES_AT_A_TIME = 4096  # of which something is asked: each takes some 10 kB meanwhile
MOST_AT_A_TIME = 256  # frames
KEPT_FRAMES = 20  # frames that are kept whatever they take: whoever follows a cable goes back by no more


class _Numbered(Sequence[Solved]):
    """Frames by number, from the first on or, below zero, from behind; or some of them."""

    @overload
    def __getitem__(self, which: int) -> Solved: ...
    @overload
    def __getitem__(self, which: slice) -> list[Solved]: ...
    def __getitem__(self, which: int | slice) -> Solved | list[Solved]:
        if isinstance(which, slice):
            return [self[k] for k in range(*which.indices(len(self)))]
        k = which + len(self) if which < 0 else which
        if not 0 <= k < len(self):
            raise IndexError(which)
        return self._at(k)

    @abc.abstractmethod
    def _at(self, k: int) -> Solved:
        """Return frame ``k``, 0 to less than all."""


class Frames(_Numbered):
    """Solved frames of one cable, all on one mesh.

    Args:
        frames: the first ones.
        most_held: bytes that may stay in memory.
    """

    def __init__(self, frames: Iterable[Solved] = (), most_held: int = MOST_HELD):
        self.most_held = most_held
        self._stowed: list[Solved] = []  # without their unknowns
        self._held: list[Solved] = []  # those that come after
        self._unknowns: RowsOnDisk | None = None
        self._estimates: list[tuple[Array, Array]] = []  # of the first blocks
        self._bytes, self._counted = 0, set[int]()
        for frame in frames:
            self.append(frame)

    def __len__(self) -> int:
        return len(self._stowed) + len(self._held)

    def _at(self, k: int) -> Solved:
        if k >= len(self._stowed) or self._unknowns is None:
            return self._held[k - len(self._stowed)]
        stub = self._stowed[k]
        return dataclasses.replace(stub, solution=dataclasses.replace(stub.solution, x=self._unknowns[k]))

    @property
    def stowed(self) -> int:
        """How many frames are on disk."""
        return len(self._stowed)

    def append(self, frame: Solved) -> None:
        """Add a frame."""
        if self._held:
            self._count(self._held[-1])  # now, as it may have been asked for more when the next one was solved from it
        self._held.append(frame)
        if self._bytes > self.most_held:
            self._stow()

    def cut(self, count: int) -> None:
        """Keep the first ``count`` frames alone."""
        if not len(self):
            return
        block = self._block
        whole = min(len(self._stowed), count // block * block)
        self._held, self._stowed = self[whole:count], self._stowed[:whole]
        del self._estimates[count // block :]
        self._recount()

    def errors(self) -> tuple[Array, Array]:
        """Return the estimated errors (P,), in L, and the largest local ones of the elements (n,)."""
        found: list[tuple[Array, Array]] = []
        for number, first in enumerate(range(0, len(self), self._block)):
            found.append(self._estimate(number, self[first : first + self._block]))
            self._recount()  # whoever had no factorised Jacobian has one now
            if self._bytes > self.most_held:
                self._stow()
        errors, local = zip(*found, strict=True)
        return np.concatenate(errors), np.max(local, axis=0)

    @property
    def _block(self) -> int:
        return at_a_time((self._stowed or self._held)[0])

    def _estimate(self, number: int, frames: Sequence[Solved]) -> tuple[Array, Array]:
        """Return the errors and the largest local errors of a block, once and for all where it is whole."""
        if number < len(self._estimates):
            return self._estimates[number]
        found = estimates(frames)
        estimate = np.array([error for error, _ in found]), np.max([local for _, local in found], axis=0)
        if len(frames) == self._block and number == len(self._estimates):
            self._estimates.append(estimate)
        return estimate

    def _stow(self) -> None:
        """Bring all whole blocks to disk, but for the last frames."""
        block, x = self._block, self._held[-1].solution.x
        if self._unknowns is None:
            self._unknowns = RowsOnDisk(len(x))
        for first in range(len(self._stowed), (len(self) - KEPT_FRAMES) // block * block, block):
            frames, bare = self._held[:block], []
            self._estimate(first // block, frames)
            for k, frame in enumerate(frames, first):
                self._unknowns[k] = frame.solution.x
                solution = dataclasses.replace(frame.solution, x=x[:0], factor=None)
                bare.append(dataclasses.replace(frame, solution=solution, trail=None))
            # in one step: a time limit may end what goes on here anywhere
            self._stowed, self._held = self._stowed + bare, self._held[block:]
        self._recount()

    def _recount(self) -> None:
        """Count what is held, but for the last frame."""
        self._bytes, self._counted = 0, set()
        for frame in self._held[:-1]:
            self._count(frame)

    def _count(self, frame: Solved) -> None:
        """Add what a frame takes; a factorised Jacobian that several share counts once."""
        object_bytes = 8_000  # bytes of a frame beside its numbers
        self._bytes += 2 * frame.solution.x.nbytes + object_bytes  # with the states at the nodes
        for factor in frame.kept_factors():
            if id(factor) not in self._counted:
                self._counted.add(id(factor))
                self._bytes += _bytes_of(factor)


class Stretches(_Numbered):
    """Solved frames of one cable, in stretches that have a mesh each; what is behind the last one is kept bare.

    Args:
        most_held: bytes of the frames of one stretch that may stay in memory.
    """

    def __init__(self, most_held: int = MOST_HELD):
        self.most_held = most_held
        self.parts: list[Frames] = []

    def __len__(self) -> int:
        return sum(len(part) for part in self.parts)

    def _at(self, k: int) -> Solved:
        for part in self.parts:
            if k < len(part):
                return part[k]
            k -= len(part)
        raise IndexError(k)

    def append(self, frame: Solved) -> None:
        """Add a frame; one on another mesh than the last one's begins a stretch."""
        if self.parts and np.array_equal(self.parts[-1][-1].bound.mesh, frame.bound.mesh):
            self.parts[-1].append(frame)
            return
        if self.parts:
            self.parts[-1] = Frames(map(bare, self.parts[-1]), self.most_held)
        self.parts.append(Frames([frame], self.most_held))

    def cut(self, count: int) -> None:
        """Keep the first ``count`` frames alone."""
        while self.parts and len(self) - len(self.parts[-1]) >= count:
            del self.parts[-1]
        if self.parts:
            self.parts[-1].cut(count - (len(self) - len(self.parts[-1])))


def stretches(frames: Iterable[Solved]) -> Stretches:
    """Return ``frames``, on one mesh or several, in stretches."""
    found = Stretches()
    for frame in frames:
        found.append(frame)
    return found


def by_mesh(frames: Sequence[Solved]) -> Iterator[Sequence[Solved]]:
    """Yield ``frames`` in turn, those together that follow each other on one mesh."""
    first = 0
    for k in range(1, len(frames) + 1):
        if k == len(frames) or not np.array_equal(frames[k].bound.mesh, frames[first].bound.mesh):
            yield frames[first:k]
            first = k


def bare(frame: Solved) -> Solved:
    """Return ``frame`` without what can be found again: its factorised Jacobian, and the frames before it."""
    return dataclasses.replace(frame, solution=dataclasses.replace(frame.solution, factor=None), trail=None)


def at_a_time(frame: Solved) -> int:
    """Return of how many frames like this one something is asked at a time, so that it takes bounded memory."""
    return int(np.clip(NODES_AT_A_TIME // len(frame.bound.mesh), 1, MOST_AT_A_TIME))


def blocks(frames: Sequence[Solved]) -> Iterator[Rod]:
    """Yield all shapes of ``frames``, which share cable and mesh, as many at a time as :func:`at_a_time` says."""
    count = at_a_time(frames[0])
    for first in range(0, len(frames), count):
        yield batch(frames[first : first + count])


def _bytes_of(factor: Factor) -> int:
    """Return about what a factorised Jacobian takes: 12 bytes for each of its own entries, and 9 for SuperLU's."""
    size: int = 12 * factor.jacobian.nnz + (0 if factor.lu is None else 9 * factor.lu.nnz)
    return size
