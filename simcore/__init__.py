"""Tissue, needle, their contact, the step that couples them, controllers, the run. README.md has the equations."""
