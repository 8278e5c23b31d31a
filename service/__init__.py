"""Everything around the simulation: command line, HTTP service, worker processes, store, recordings, web pages."""
