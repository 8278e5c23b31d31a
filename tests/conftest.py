"""What all tests share: the plugin of `tests/verification.py`."""

pytest_plugins = ["tests.verification"]
