"""Parameter grids: the suite, its report and its page, built on the statistics, tables and page of `paper`."""
