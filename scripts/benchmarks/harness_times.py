"""What a harness costs beside its spans: a cable through clips of one kind, 2 to 40 spans, through a motion.

    python scripts/benchmarks/harness_times.py

Every row is simulated through the public API, everything included, in frames that are given. The peer, in the same run,
is the same spans between fixed clips that stand as they were found. Medians of three; every solve keeps to one thread.
"""

from __future__ import annotations

import dataclasses
import statistics
import time

import numpy as np

import harness_opt as ho

FRAMES = np.linspace(0.0, 1.0, 31)
RUNS = 3


def row(kind: str, spans: int) -> ho.Problem:
    """Return a cable in a wavy row of clips, its end on a slide."""
    step, slack = 0.2, 1.08
    places = [(step * k, 0.0, 0.03 * (k % 2)) for k in range(spans + 1)]
    tangent = (1.0, 0.0, 0.0)
    clips = tuple(
        ho.Clip(
            name=f"c{k}",
            at=slack * step * k,
            kind=kind,
            position=places[k],
            tangent=None if kind in ("pivot", "ring") else tangent,
            roll_deg=0.0 if kind == "fixed" else None,
        )
        for k in range(1, spans)
    )
    run = ho.CableRun(
        ho.Cable(slack * step * spans, 0.008, 0.02, 0.015, 0.2),
        ho.End(places[0], tangent=tangent, roll_deg=0),
        ho.End(places[-1], tangent=tangent, roll_deg=0, body="slide"),
        clips=clips,
    )
    bodies = {"slide": ho.Body(ho.Slide((0.3, 0, 1), 0.0, 0.02))}
    return ho.Problem({"lead": run}, bodies, gravity=(0, 0, -9.81))


def branched() -> ho.Problem:
    """Return a trunk that branches in a splice which hangs, one branch moving."""
    thick, thin = ho.Cable(0.3, 0.008, 0.02, 0.015, 0.2), ho.Cable(0.25, 0.006, 0.01, 0.008, 0.1)
    held = {"roll_deg": 0.0}

    def on(y: float, x: float = 0.01) -> ho.End:
        return ho.End((x, y, 0), tangent=(1, 60 * y, 0), body="splice", **held)

    ends = (
        ho.End((0.45, 0.1, 0.2), tangent=(0, 0, 1), body="arm", **held),
        ho.End((0.45, -0.1, 0.15), tangent=(0, 0, 1), **held),
    )
    cables = {
        "trunk": ho.CableRun(thick, ho.End((0, 0, 0.2), tangent=(1, 0, 0), **held), on(0.0, -0.01)),
        "a": ho.CableRun(thin, on(0.005), ends[0]),
        "b": ho.CableRun(thin, on(-0.005), ends[1]),
    }
    arm = ho.Body(ho.Hinge((0.45, 0.1, 0.1), (0, 1, 0), -0.3, 0.3))
    return ho.Problem(cables, {"splice": ho.Body(free=True, mass=0.02), "arm": arm}, gravity=(0, 0, -9.81))


def as_found(motion: ho.Motion) -> ho.Problem:
    """Return the problem of ``motion`` with everything free on bodies that move as it was found, nothing coupled."""
    problem, bodies, runs = motion.problem, dict(motion.problem.bodies), {}
    times = tuple(motion.motion.tolist())
    for name, found in problem.found.items():
        positions, quaternions = found.poses(motion.motion)
        poses = ho.Poses(times, tuple(map(tuple, positions.tolist())), tuple(map(tuple, quaternions.tolist())))
        bodies[name.replace(", ", ".")] = ho.Body(poses)
    for name, run in problem.cables.items():
        clips = []
        for clip in run.clips:
            body = f"{name}.{clip.name}"
            if body in bodies:
                fixed = {
                    "kind": "fixed",
                    "tangent": None,
                    "quaternion": (1.0, 0.0, 0.0, 0.0),
                    "position": (0.0, 0.0, 0.0),
                }
                place = problem.found[f"{name}, {clip.name}"].places
                at = clip.at if place is None else float(place[0])
                clips.append(dataclasses.replace(clip, body=body, at=at, roll_deg=None, **fixed))
            else:
                clips.append(clip)
        runs[name] = dataclasses.replace(run, clips=tuple(clips))
    return problem.changed(cables=runs, bodies=bodies, found={})


def frame_times(problem: ho.Problem) -> tuple[float, float, ho.Motion]:
    """Return seconds for the first frame, and for each that follows, and the motion."""
    whole, first = [], []
    for _ in range(RUNS):
        begin = time.perf_counter()
        motion = ho.simulate(problem, frames=FRAMES)
        whole.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        ho.simulate(problem, frames=FRAMES[:1])
        first.append(time.perf_counter() - begin)
    cold = statistics.median(first)
    return cold, (statistics.median(whole) - cold) / (len(FRAMES) - 1), motion


def main() -> None:
    """Print a row for each harness."""
    print(f"{'harness':26}{'spans':>6}{'first, ms':>11}{'warm, ms':>10}{'a span, ms':>12}{'x its spans':>13}")
    rows = [(kind, row(kind, 5)) for kind in ("fixed", "swivel", "pivot", "sleeve", "ring")]
    rows.append(("splice, branched", branched()))
    rows += [("pivot", row("pivot", count)) for count in (2, 10, 20, 40)]
    for name, problem in rows:
        cold, warm, motion = frame_times(problem)
        spans = sum(len(run.clips) + 1 for run in problem.cables.values())
        slides = any(found.places is not None for found in motion.problem.found.values())
        ratio = "-" if slides or not motion.problem.found else f"{warm / frame_times(as_found(motion))[1]:.2f}"
        print(
            f"{name:26}{spans:6}{1e3 * cold:11.0f}{1e3 * warm:10.1f}{1e3 * warm / spans:12.2f}{ratio:>13}", flush=True
        )


if __name__ == "__main__":
    main()
