"""Tables of numbers: CSV files as programs and spreadsheets write them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

from .text import read_text

__all__ = ["read_numbers"]

_DELIMITERS = {",": "a comma", ";": "a semicolon", "\t": "a tab"}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_NOT_FINITE = ("nan", "inf", "infinity")
_SHOWN = 60  # characters of a line in a message


def read_numbers(path: Path | str, columns: Sequence[str], *, gaps: bool = False) -> list[tuple[float, ...]]:
    """The rows of a CSV file with a header: the numbers of `columns`, in that order. Empty lines are left out.
    With `gaps`, numbers need not be finite, empty cells are nan, and lines of only empty cells are rows, except at the
    end.

    Cells are separated by commas, semicolons or tabs, and may be quoted. The header's names may differ in letter case,
    and there may be other columns. With semicolons or tabs, numbers may have decimal commas instead of points, the same
    in the whole file. Raises ValueError, which names the file, the line, the column, the value and what was expected,
    and OSError if the file cannot be read.
    """
    path = Path(path)
    lines = [(number, line) for number, line in enumerate(read_text(path).split("\n"), 1) if line.strip()]
    if lines and re.fullmatch(r'"?sep=."?', lines[0][1].strip()):  # spreadsheets tell the delimiter to one another
        del lines[0]
    table = _Table(path.name, tuple(columns), lines[0][1] if lines else "", gaps)
    empty = f" \t\xa0{table.delimiter}"
    filled = [number for number, line in lines[1:] if line.strip(empty)]
    last = filled[-1] if filled else 0
    return [table.row(number, line) for number, line in lines[1:] if line.strip(empty) or (gaps and number < last)]


class _Table:
    """A table whose header is known: its delimiter, its columns, and the decimal mark as soon as one was seen."""

    def __init__(self, file: str, columns: tuple[str, ...], header: str, gaps: bool) -> None:
        self.file, self.columns, self.gaps = file, columns, gaps
        for self.delimiter in _DELIMITERS:
            names = [cell.strip().casefold() for cell in self._cells(1, header)]
            if {name.casefold() for name in columns} <= set(names):
                break
        else:
            raise ValueError(f"{file}: header: {_short(header)}: expected {','.join(columns)}")
        for name in columns:
            if names.count(name.casefold()) > 1:
                raise ValueError(f"{file}: header: {_short(header)}: expected one column {name}")
        self.width = len(names)
        self.order = [names.index(name.casefold()) for name in columns]
        self.mark: tuple[str, int] | None = None  # the decimal mark, and the line where it was first seen

    def row(self, number: int, line: str) -> tuple[float, ...]:
        """The numbers of a line."""
        cells = self._cells(number, line)
        if any(cell.strip() for cell in cells[self.width :]):
            hint = "; decimal commas need semicolons between cells" if self.delimiter == "," else ""
            expected = f"expected {self.width}, as in the header{hint}"
            raise ValueError(f"{self.file}: line {number}: {len(cells)} cells: {_short(line)}: {expected}")
        cells += [""] * (self.width - len(cells))
        chosen = [cells[index].strip() for index in self.order]
        return tuple(self._number(number, *item) for item in zip(self.columns, chosen, strict=True))

    def _cells(self, number: int, line: str) -> list[str]:
        try:
            return next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True), [])
        except csv.Error as error:
            expected = f"expected cells that {_DELIMITERS[self.delimiter]} separates ({error})"
            raise ValueError(f"{self.file}: line {number}: {_short(line)}: {expected}") from error

    def _number(self, line: int, column: str, cell: str) -> float:
        place = f"{self.file}: line {line}: {column}: {_short(cell)}"
        text = cell.replace("\N{MINUS SIGN}", "-")
        if self.gaps and (not text or text.lower().lstrip("+-") in _NOT_FINITE):
            return float(text or "nan")
        mark = next((mark for mark in ".," if mark in text), "")
        if mark == "," and self.delimiter == ",":
            raise ValueError(f"{place}: expected a decimal point; decimal commas need semicolons between cells")
        value = float(text.replace(",", ".")) if _NUMBER.fullmatch(text.replace(",", ".")) else math.nan
        if not math.isfinite(value):
            raise ValueError(f"{place}: expected a finite number")
        if mark:
            known, where = self.mark = self.mark or (mark, line)
            if mark != known:
                raise ValueError(f"{place}: expected the decimal mark of line {where}, {known!r}")
        return value


def _short(text: str) -> str:
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "...")
