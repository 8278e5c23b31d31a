"""Numbers one after the other, out of text or out of bytes; every fault says where it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from simcore.mesh.formats.raw import FormatError

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

CHUNK = 200_000  # numbers that are turned from text at once


class Cursor(Protocol):
    """A place in a file, which every call moves on; FormatError where the file does not hold what is asked."""

    def line(self) -> str:
        """The next line that is not empty, stripped."""

    def numbers(self, count: int, dtype: DTypeLike) -> Any:
        """The next `count` numbers, (count,)."""

    def fault(self, reason: str) -> FormatError:
        """The error that says what is wrong here."""


class TextCursor:
    """In text: numbers stand between blanks and line ends. comment: what begins one that goes to the line's end."""

    def __init__(self, data: bytes, comment: bytes = b"") -> None:
        self._lines = data.splitlines()
        self._words: list[bytes] = []  # of the current line
        self._next = 0
        self._comment = comment
        self.number = 0

    def fault(self, reason: str) -> FormatError:
        """With the number of the line that was read last."""
        return FormatError(f"line {max(self.number, 1)}: {reason}")

    @property
    def at_end(self) -> bool:
        """Whether nothing but empty lines follows."""
        while self._next >= len(self._words) and self.number < len(self._lines):
            self._words, self._next = self._split(self._lines[self.number]), 0
            self.number += 1
        return self._next >= len(self._words)

    def line(self) -> str:
        """The next line that is not empty, or what is left of the current one."""
        return as_text(b" ".join(self._taken(None)))

    def word(self) -> str:
        """The next word."""
        return as_text(self._taken(1)[0])

    def put_back(self, line: str) -> None:
        """Make `line` what comes next."""
        self._words, self._next = [*line.encode().split(), *self._words[self._next :]], 0

    def numbers(self, count: int, dtype: DTypeLike) -> Any:
        """Across line ends."""
        parts, words, left = [], list[bytes](), count
        begin = self.number
        while left > 0:
            taken = self._taken(left)
            words += taken
            left -= len(taken)
            if len(words) >= CHUNK or left == 0:
                parts.append(self._converted(words, dtype, begin))
                words, begin = [], self.number
        return np.concatenate(parts) if parts else np.zeros(0, dtype)

    def _taken(self, count: int | None) -> list[bytes]:
        """At most `count` words of the current line; None = all that are left."""
        if self.at_end:
            raise self.fault("the file ends here, too early")
        end = len(self._words) if count is None else min(len(self._words), self._next + count)
        taken = self._words[self._next : end]
        self._next = end
        return taken

    def skip_to_empty_line(self) -> None:
        """Past the next empty line, or to the end."""
        self._next = len(self._words)
        while self.number < len(self._lines) and self._lines[self.number].strip():
            self.number += 1

    def _split(self, line: bytes) -> list[bytes]:
        return (line.split(self._comment, 1)[0] if self._comment else line).split()

    def _converted(self, words: list[bytes], dtype: DTypeLike, begin: int) -> Any:
        try:
            return np.array(words, np.dtype(dtype))
        except (ValueError, OverflowError):
            wrong = next((word for word in words if not _is_number(word, dtype)), words[0])
            lines = range(max(begin - 1, 0), self.number)
            self.number = 1 + next((i for i in lines if wrong in self._split(self._lines[i])), self.number - 1)
            kind = "an integer" if np.dtype(dtype).kind in "iu" else "a number"
            raise self.fault(f"{as_text(wrong)[:40]!r} is not {kind}") from None


class BinaryCursor:
    """In bytes of one order, '<' or '>'."""

    def __init__(self, data: bytes, order: Literal["<", ">"] = "<") -> None:
        self.data, self.at = data, 0
        self.order: Literal["<", ">"] = order

    def fault(self, reason: str) -> FormatError:
        """With the number of the byte."""
        return FormatError(f"byte {self.at}: {reason}")

    @property
    def at_end(self) -> bool:
        """Whether nothing but blanks follows."""
        return not self.data[self.at : self.at + 100_000].strip()

    def line(self) -> str:
        """The next line that is not empty."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at)
            end = len(self.data) if end < 0 else end
            text = as_text(self.data[self.at : end][:10_000]).strip()
            self.at = end + 1
            if text:
                return text
        raise self.fault("the file ends here, too early")

    def numbers(self, count: int, dtype: DTypeLike) -> Any:
        """As they lie in the file, in the machine's order."""
        kind = np.dtype(dtype).newbyteorder(self.order)
        if count < 0 or count * kind.itemsize > len(self.data) - self.at:
            raise self.fault(f"{count} numbers of {kind.itemsize} bytes are announced, the file ends before")
        values = np.frombuffer(self.data, kind, count, self.at)
        self.at += count * kind.itemsize
        return values.astype(np.dtype(dtype))

    def skip_past(self, mark: bytes) -> None:
        """To behind the next `mark`."""
        found = self.data.find(mark, self.at)
        if found < 0:
            raise self.fault(f"{as_text(mark)} is missing")
        self.at = found + len(mark)


def as_text(data: bytes) -> str:
    """UTF-8, or what western systems wrote before it."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def _is_number(word: bytes, dtype: DTypeLike) -> bool:
    try:
        np.array([word], np.dtype(dtype))
    except (ValueError, OverflowError):
        return False
    return True


def integer(cursor: Cursor, text: str) -> int:
    """The integer that `text` is. Raises FormatError."""
    if not text.strip().lstrip("+-").isdecimal() or len(text) > 30:
        raise cursor.fault(f"{text[:40]!r} is not an integer")
    return int(text)
