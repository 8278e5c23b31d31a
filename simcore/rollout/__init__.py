"""A run from first step to result: the loop, its records, series, files on disk and data sets."""
