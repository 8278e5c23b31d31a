"""The plant: one insertion step by step, the solver of a coupled step, and the Jacobians of a converged step."""
