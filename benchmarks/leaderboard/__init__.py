"""Static pages from bundles: every arm that ran the same tasks, beside each other, with what it rests on."""
