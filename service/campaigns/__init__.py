"""Use cases of campaigns: progress, results of the cases, comparisons, trends, reports."""
