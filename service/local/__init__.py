"""Work without a service: one run, the runs of a data set, a rerun of the paper, verification of a result."""
