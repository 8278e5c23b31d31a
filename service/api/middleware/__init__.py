"""What every request passes through, outermost first in `service.app`. Plain ASGI layers."""
