"""What all tests share: the plugin of `tests/verification.py`, and a Ctrl-C that works."""

import signal

pytest_plugins = ["tests.verification"]

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job; a child would ignore it too
    signal.signal(signal.SIGINT, signal.default_int_handler)
