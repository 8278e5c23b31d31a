"""Insertions on the machines of a cluster, by Dask: the second executor of many cases, beside `service.worker.crew`."""
