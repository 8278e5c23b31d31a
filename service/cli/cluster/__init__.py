"""Commands whose insertions may run on a cluster, and those that start one."""
