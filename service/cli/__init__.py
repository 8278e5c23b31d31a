"""The command `needlebench`, one file for each group of commands."""
