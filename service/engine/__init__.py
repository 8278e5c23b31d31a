"""The engine of a running service: slots, their watchdog, attempts, housekeeping, retention, metrics, health checks."""
