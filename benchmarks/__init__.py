"""Speed, convergence, the rerun of the paper, parameter grids. Pure: callers provide processes and files."""
