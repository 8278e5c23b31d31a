"""Tetrahedral meshes: the built-in box, meshes from files, their checks, and finding a point in them."""
