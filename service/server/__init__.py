"""The server process: start, HTTP protocol, a service of one's own for a command, and the check of an installation."""
