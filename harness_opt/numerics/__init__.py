"""Numerics that know no cable: rotations, quadrature, linear algebra, extrapolation, and one solver a file."""
