"""What all tests share: the plugin of `tests/verification.py`, no deadlines, and a Ctrl-C that works."""

import signal

from hypothesis import HealthCheck, settings

from tests.budget import examples

pytest_plugins = ["tests.verification"]

settings.register_profile(
    "untimed",  # a busy machine makes no test fail
    settings.default,
    deadline=None,
    max_examples=examples(100),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job; a child would ignore it too
    signal.signal(signal.SIGINT, signal.default_int_handler)
