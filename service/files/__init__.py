"""Small files and their names: uploads by name, locks, disk space, series in other formats."""
