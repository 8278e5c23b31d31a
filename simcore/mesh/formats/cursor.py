"""Numbers one after the other, out of text or out of bytes; every fault says where it is."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from simcore.mesh.formats.raw import FormatError

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

CHUNK = 200_000  # numbers that are turned from text at once
LONGEST_LINE = 10_000  # bytes of a line between binary numbers
LONGEST_INTEGER = 18  # characters: it fits in 64 bits
_NOT_BLANK = re.compile(rb"\S")


class WordError(ValueError):
    """A word that is no number of the type that is asked for."""

    def __init__(self, word: bytes, dtype: np.dtype[Any]) -> None:
        self.word = word
        kind = "an integer" if dtype.kind in "iu" else "a number"
        if dtype.kind in "iu" and re.fullmatch(rb"[+-]?[0-9]+", word):
            kind += f" from {np.iinfo(dtype).min} to {np.iinfo(dtype).max}"
        super().__init__(f"{as_text(word)[:40]!r} is not {kind}")


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
        self._altered = False  # whether the words are not those of the line
        self.number = 0

    def fault(self, reason: str) -> FormatError:
        """With the number of the line that was read last."""
        return FormatError(f"line {max(self.number, 1)}: {reason}")

    @property
    def at_end(self) -> bool:
        """Whether nothing but empty lines follows."""
        while self._next >= len(self._words) and self.number < len(self._lines):
            self._words, self._next, self._altered = self._split(self._lines[self.number]), 0, False
            self.number += 1
        return self._next >= len(self._words)

    def line(self) -> str:
        """The next line that is not empty, with the blanks inside it, or the words that are left of the current one."""
        words = self._taken(None)
        whole = len(words) == len(self._words) and not self._altered
        return as_text(self._uncommented(self._lines[self.number - 1]).strip() if whole else b" ".join(words))

    def word(self) -> str:
        """The next word."""
        return as_text(self._taken(1)[0])

    def put_back(self, line: str) -> None:
        """Make `line` what comes next."""
        self._words, self._next = [*line.encode().split(), *self._words[self._next :]], 0
        self._altered = True

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
        return self._uncommented(line).split()

    def _uncommented(self, line: bytes) -> bytes:
        return line.split(self._comment, 1)[0] if self._comment else line

    def _converted(self, words: list[bytes], dtype: DTypeLike, begin: int) -> Any:
        try:
            return parsed(words, dtype)
        except WordError as error:
            lines = range(max(begin - 1, 0), self.number)
            self.number = 1 + next((i for i in lines if error.word in self._split(self._lines[i])), self.number - 1)
            raise self.fault(f"{error}") from None


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
        return _NOT_BLANK.search(self.data, self.at) is None

    def line(self) -> str:
        """The next line that is not empty."""
        while (start := _NOT_BLANK.search(self.data, self.at)) is not None:
            end = self.data.find(b"\n", start.start())
            end = len(self.data) if end < 0 else end
            text = as_text(self.data[start.start() : min(end, start.start() + LONGEST_LINE)]).strip()
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

    def skip_past(self, mark: bytes, name: str = "") -> None:
        """To behind the next `mark`. name: what a sentence calls it."""
        found = self.data.find(mark, self.at)
        if found < 0:
            raise self.fault(f"{name or as_text(mark)} is missing")
        self.at = found + len(mark)


def as_text(data: bytes) -> str:
    """UTF-8, or what western systems wrote before it."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def parsed(words: list[bytes], dtype: DTypeLike) -> Any:
    """The numbers that words are. Raises WordError for the first that is none."""
    kind = np.dtype(dtype)
    try:
        return _as_numbers(words, kind)
    except (ValueError, OverflowError):
        wrong = next((word for word in words if not _is_number(word, kind)), words[0])
        raise WordError(wrong, kind) from None


def _as_numbers(words: list[bytes], kind: np.dtype[Any]) -> Any:
    """Raises ValueError and OverflowError, for 1_000 too, which is a number to Python alone."""
    if b"_" in b"".join(words):
        raise ValueError
    return np.array(words, kind)


def _is_number(word: bytes, kind: np.dtype[Any]) -> bool:
    try:
        _as_numbers([word], kind)
    except (ValueError, OverflowError):
        return False
    return True


def integer(cursor: Cursor, text: str) -> int:
    """The integer that `text` is. Raises FormatError."""
    if not re.fullmatch(r"[+-]?[0-9]+", text):
        raise cursor.fault(f"{text[:40]!r} is not an integer")
    if len(text) > LONGEST_INTEGER:
        raise cursor.fault(f"{text[:40]} is too large an integer")
    return int(text)
