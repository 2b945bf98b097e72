"""Solid parts as geometry that answers distances of points: primitives in closed form, meshes by coal."""
