"""The HTTP surface: routes, their JSON, what every request passes through, and the one shape of errors."""
