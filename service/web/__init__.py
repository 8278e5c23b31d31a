"""The web pages: rendered on the server, updated by small scripts, all from this folder."""
