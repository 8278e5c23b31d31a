"""Readers of the mesh formats that are promised: each reads right what it reads, refuses the rest with place."""
