"""Training of learned controllers: the insertions of the data set, and the fit with its errors."""
