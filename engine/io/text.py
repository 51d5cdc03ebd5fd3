"""Text files as other systems write them: their encodings and their ends of lines."""

from __future__ import annotations

import codecs
from pathlib import Path

__all__ = ["ENCODINGS", "read_text"]

ENCODINGS = ("UTF-8", "UTF-16 LE", "UTF-16 BE", "UTF-32 LE", "UTF-32 BE")

_LARGEST_BYTES = 1 << 28  # a video that is given by mistake shall not be read into memory
_MARKS = {  # UTF-32 before UTF-16, whose mark begins like it
    codecs.BOM_UTF8: "UTF-8",
    codecs.BOM_UTF32_LE: "UTF-32 LE",
    codecs.BOM_UTF32_BE: "UTF-32 BE",
    codecs.BOM_UTF16_LE: "UTF-16 LE",
    codecs.BOM_UTF16_BE: "UTF-16 BE",
}


def read_text(path: Path | str) -> str:
    r"""The text of a file. Ends of lines (LF, CRLF or CR) become "\n"; a byte order mark is left out.

    The byte order mark tells the encoding, one of ENCODINGS. A file without one is UTF-16 or UTF-32 if it has zero
    bytes where ASCII characters would have them, otherwise UTF-8. Raises ValueError, which names the file, the place,
    the byte and the encodings, for anything else, and OSError if the file cannot be read.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > _LARGEST_BYTES:
        raise ValueError(f"{path.name}: {size} bytes: expected a text file of at most {_LARGEST_BYTES} bytes")
    data = path.read_bytes()
    mark = next((mark for mark in _MARKS if data.startswith(mark)), b"")
    tried: tuple[str, ...] = (_MARKS.get(mark, "UTF-8"),)
    if not mark and b"\0" in data:
        text, tried = _wide_text(data), ENCODINGS
    else:
        text = _decoded(data[len(mark) :], tried[0])
    if text is None or "\0" in text:
        raise ValueError(f"{path.name}: {_first_fault(data, len(mark), tried[0])}: expected {' or '.join(tried)} text")
    return _with_line_feeds(text)


def _wide_text(data: bytes) -> str | None:
    """UTF-16 or UTF-32 without a byte order mark: the encoding in which most characters are ASCII, and none is zero."""
    for encoding in ("UTF-32 LE", "UTF-32 BE", "UTF-16 LE", "UTF-16 BE"):
        text = _decoded(data, encoding)
        if text is not None and "\0" not in text and 2 * sum(map(str.isascii, text)) > len(text):
            return text
    return None


def _decoded(data: bytes, encoding: str) -> str | None:
    try:
        return data.decode(_codec(encoding))
    except UnicodeDecodeError:
        return None


def _first_fault(data: bytes, start: int, encoding: str) -> str:
    """The place and the value of the first byte, from `start` on, that is no text in an encoding."""
    codec = _codec(encoding)
    try:
        before = data[start:].decode(codec).partition("\0")[0]
        index = start + len(before.encode(codec))
    except UnicodeDecodeError as error:
        index = start + error.start
        before = data[start:index].decode(codec)
    return f"line {_with_line_feeds(before).count(chr(10)) + 1}, byte {index}: 0x{data[index]:02x}"


def _with_line_feeds(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _codec(encoding: str) -> str:
    return encoding.replace(" ", "-").lower()
