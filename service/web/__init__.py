"""The web pages: rendered on the server, kept alive by small scripts of their own, all from this folder."""
