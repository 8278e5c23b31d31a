"""The engine of a running service: slots, attempts, housekeeping, retention, metrics and health checks."""
