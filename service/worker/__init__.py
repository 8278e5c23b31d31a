"""Worker processes: what one does with a job, and many insertions on several. Knows no database and no HTTP."""
