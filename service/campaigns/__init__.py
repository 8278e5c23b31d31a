"""What campaigns amount to: results, comparisons, trends and reports."""
