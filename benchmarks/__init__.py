"""Speed, convergence, the rerun of the paper, parameter grids. Pure: processes and files are handed in."""
