"""What can be asked about campaigns: how they go, what their cases measured, comparisons, trends, reports."""
