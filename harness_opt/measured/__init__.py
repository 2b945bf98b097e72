"""Stiffness of real cables from what was measured of them: shapes, sags, forces, and the twist at which they snap."""
