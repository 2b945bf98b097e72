"""One pose: from what holds a cable's two ends to an accurate, stable equilibrium, or an honest failure."""
