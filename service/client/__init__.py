"""The Python client of the HTTP service; documented as `from needlebench import Client`."""
