"""How an attempt ended, in words that can be stored and sent, whatever it raised: short, plain text, never an error."""

from __future__ import annotations

from pathlib import Path

MOST_CHARACTERS = 2000  # of a message; the whole one is in the job's log, as far as that has room


def storable(text: str) -> str:
    """The text in Unicode that every encoder takes, cut after MOST_CHARACTERS; its length stands where it was cut."""
    plain = text[:MOST_CHARACTERS].encode("utf-8", "backslashreplace").decode()[:MOST_CHARACTERS]
    return plain if len(text) <= MOST_CHARACTERS else f"{plain}... ({len(text)} characters)"


def described(failure: BaseException) -> str:
    """Kind and message of what was raised, storable."""
    kind = storable(type(failure).__name__)
    try:
        message = storable(str(failure))
    except BaseException:  # noqa: BLE001  (an exception of somebody else's: its text is their code)
        message = "its message cannot be shown"
    where = "".join(f" ({storable(note)})" for note in getattr(failure, "__notes__", []) if isinstance(note, str))
    return f"{kind}: {message}{where}" if message else f"{kind}{where}"


def described_with_place(failure: BaseException) -> str:
    """The same with file and line of the code that raised it, or that raised what it was raised from."""
    origin = failure
    while origin.__cause__ is not None:
        origin = origin.__cause__
    trace = origin.__traceback__
    if trace is None:
        return described(failure)
    while trace.tb_next is not None:
        trace = trace.tb_next
    file = storable(Path(trace.tb_frame.f_code.co_filename).name)
    return f"{described(failure)} ({file}, line {trace.tb_lineno})"
