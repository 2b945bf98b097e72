"""What is counted in pictures: pixels of a hue, and actors of a kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.model.results import Motion
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import stills as pictures


def pixels(pyvista, file: Path) -> np.ndarray:
    """Return the picture (h, w, 3), 0 to 255."""
    image = pyvista.read(file)
    width, height, _ = image.dimensions
    return np.asarray(image.active_scalars).reshape(height, width, -1)[::-1, :, :3].astype(int)


def like(image: np.ndarray, colour: str) -> int:
    """Return how many pixels have the hue of ``colour`` and are not pale."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    wanted = np.array([red, green, blue]) - np.mean([red, green, blue])
    grey = image.mean(axis=-1, keepdims=True)
    strength = np.linalg.norm(image - grey, axis=-1)
    alike = (image - grey) @ wanted / (np.maximum(strength, 1e-9) * np.linalg.norm(wanted))
    return int(np.sum((strength > 0.6 * np.linalg.norm(wanted)) & (alike > 0.98)))


def view_of(motion: Motion):
    scene = load_scene(motion.problem)
    found = measure(motion.problem, scene, motion.motion, motion.cables)
    return pictures.worst_view(motion, scene, all_limits(motion.problem, motion, found), "Worst")


def names(actors, kind: str) -> set[str]:
    return {name.removeprefix(f"{kind}:") for name in actors if name.startswith(f"{kind}:")}
