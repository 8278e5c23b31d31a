"""The named suites: those of the paper, and those of our own."""
