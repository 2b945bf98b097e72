"""The Kirchhoff rod without dimensions: its equations, boundary conditions, discretisations, states and stability."""
