"""What this project does past the public surface of Rerun 0.41, which keeps the threads of every recording until its
process ends: two of the recording, two of its layout. A worker makes thousands.

Written against that version; the test of the threads that a recording leaves says when it does not hold any more.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import rerun as rr
import rerun_bindings

if TYPE_CHECKING:
    from pathlib import Path

    import rerun.blueprint as rrb


def write_to_file(stream: rr.RecordingStream, path: Path, layout: rrb.Blueprint, application: str) -> None:
    """What the stream is sent goes to the file, which opens with the layout: `set_sinks`, whose layout ends too."""
    native = rerun_bindings.new_blueprint(
        application_id=application, make_default=False, make_thread_default=False, default_enabled=True
    )
    sent = rr.RecordingStream._from_native(native)  # noqa: SLF001  (as Rerun's own `set_sinks` does)
    sent.set_time("blueprint", sequence=0)
    layout._log_to_stream(sent)  # noqa: SLF001  (the same)
    storage = rerun_bindings.memory_recording(recording=native)
    rerun_bindings.set_sinks([rr.FileSink(path)], default_blueprint=storage, recording=stream.to_native())
    sent.disconnect()  # its memory holds the stream that fills it, and neither would go


def end(stream: rr.RecordingStream, *, within_s: float) -> None:
    """Write what it was sent and disconnect it.

    Raises RuntimeError where its writer has died or does not get on. Whatever ends or drops such a stream may wait for
    ever, so it is kept until the process has ended, and Rerun's own end of the process is left out.
    """
    try:
        stream.flush(timeout_sec=within_s)
    except RuntimeError:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
        rr.unregister_shutdown()
        raise
    stream.disconnect()


def end_threads() -> None:
    """End those of the streams that nothing refers to any more."""
    rerun_bindings.flush_and_cleanup_orphaned_recordings()
