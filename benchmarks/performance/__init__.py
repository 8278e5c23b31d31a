"""How fast: kernels, whole steps, scaling, start-up, memory, the cost of recording. L0 is the unit."""
