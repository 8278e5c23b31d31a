"""Small linear algebra whose sums have one order on every processor: what a result depends on goes through no BLAS."""
