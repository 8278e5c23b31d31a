"""The engine of a running service: slots and their watchdog, attempts, housekeeping, retention, metrics and health checks."""
