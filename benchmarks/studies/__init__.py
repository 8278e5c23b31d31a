"""Studies of the model: convergence over mesh, needle and time step; the force curve of one insertion."""
