"""What a redesign found, in sentences: where it began, what is in the way, what would do, what limits cost."""

from __future__ import annotations

LENGTH, ANGLE = ("mm", 1e3, 1.0), ("deg", 1.0, 1.0)  # of bounds
