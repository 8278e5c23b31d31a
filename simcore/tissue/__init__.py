"""Soft tissue: co-rotational tetrahedra, their forces and tangent, and the breathing of the held nodes."""
