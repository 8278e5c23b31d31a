"""Parameter grids: the suite, its report and its page."""
