"""Recorded samples from a text file as loggers and spreadsheets write them: what is understood, and what is refused.

Nothing is guessed that could be read in two ways. What is found out (encoding, delimiter, decimal mark, units, origin
of the clock, repeated stamps) is said in one line; what cannot be found out is refused with the key that helps.
"""

import codecs
import csv
import datetime as dt
import math
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.input.faults import listed, shown
from cls_bench.text import escaped

Array = NDArray[np.float64]

MOST_BYTES = 64_000_000
"""Largest sample file [B]: an hour at 1 kHz."""

DELIMITERS = (",", ";", "\t", "|", " ")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0,
              "d": 86400.0}  # fmt: skip
"""Length of a unit of time [s]."""

FASTEST = 60.0
"""Greatest rate of an angle [rad/s]: 18 m/s at the grip, faster than any hand."""

LARGEST = {"deg": 170.0, "N": 2000.0}
"""Greatest magnitude of an angle [deg] and of a force [N], in every segment. No control turns further."""

CLOSEST = 50e-6
"""Samples closer than this are averaged [s]: the bench's usual tick, shorter than anything a hand does."""

_SPELT = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "sekunden": "s",
    "ms": "ms", "msec": "ms", "millis": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us", "microsecond": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "min": "min", "minute": "min", "minutes": "min", "h": "h", "hour": "h", "hours": "h",
    "d": "d", "day": "d", "days": "d",
}  # fmt: skip
"""Units of time as headers spell them."""

_FACTORS = {
    "deg": {"deg": 1.0, "°": 1.0, "degree": 1.0, "degrees": 1.0,
            "rad": 180.0 / math.pi, "mrad": 0.18 / math.pi},
    "N": {"n": 1.0, "newton": 1.0, "newtons": 1.0, "kn": 1e3, "mn": 1e-3, "MN": 1e6, "dan": 10.0,
          "lbf": 4.4482216152605, "lb": 4.4482216152605, "kgf": 9.80665, "kp": 9.80665, "kg": 9.80665, "g": 9.80665e-3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "°": math.pi / 180.0},
    "kt": {"kt": 1.0, "kts": 1.0, "kn": 1.0, "knots": 1.0, "m/s": 3600.0 / 1852.0, "km/h": 1.0 / 1.852},
    "ft": {"ft": 1.0, "feet": 1.0, "m": 1.0 / 0.3048},
}  # fmt: skip
"""For each unit that values are wanted in, the factor from units that a header may name; of others none is known."""

_OTHER_UNITS = ("mv", "ma", "nm", "oz", "gon", "grad", "pct", "percent")
"""Units of no known factor that end a header such as ``force_mA``; in brackets any unit is seen."""

_TIME_NAMES = ("time", "t", "timestamp", "time stamp", "timestamps", "times", "zeit", "zeitstempel", "elapsed")
"""Headers that mean the time where no column is named."""

_SEARCHED = 200
"""Lines among which the header is looked for."""

LONGEST_HEADER = 200
"""Characters of a cell that can be a name with a unit; what is longer is neither, and not searched for one."""

_COMMENT = re.compile(r"\s*(#|%|//)")
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
_ZONE = r"(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?"
_CLOCK = re.compile(r"(\d{1,4}):([0-5]\d)(?::([0-5]\d))?(\.\d+)?" + _ZONE, re.ASCII)
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?" + _ZONE, re.ASCII)
_TIMECODE = re.compile(r"(\d{4}-\d\d-\d\d[T ])?\d+:\d+:\d+[:;]\d.*", re.ASCII)
_FIRST_FIELD = {"min": r"m+:s+(\W\w+)?|min:s(ec)?", "h": r"h+:m+|h:min"}
"""How headers name a clock of two fields, by the unit of its first field."""

_HUNDREDS = {"FILETIME, since 1601": (1.1e17, 1.6e17), "ticks of .NET, since year 1": (6.2e17, 6.7e17)}
"""Clocks that count 100 ns, and what they show in our days."""

_SERIAL_DAYS = (20_000.0, 80_000.0)
"""What a spreadsheet's count of days shows in our days."""

_DAY = TIME_UNITS["d"]

_NEAR = 0.99 * CLOSEST
"""Stamps nearer to each other than this are one [s]: 50 µs, less what stamps since 1970 are rounded by."""


def _factors(unit: str) -> Mapping[str, float]:
    return _FACTORS.get(unit, {unit: 1.0, unit.casefold(): 1.0})


class Keys(NamedTuple):
    """What a segment says of its file; None where it is to be found out."""

    unit: str
    """``deg`` or ``N`` of a hand, any other of a parameter"""
    column: str
    time_column: str | None = None
    time_unit: str | None = None
    time_zero: float | None = None
    delimiter: str | None = None
    decimal: str | None = None
    skip: int = 0
    scale: float | None = None
    offset: float | None = None
    bounds: tuple[float, float] | None = None
    """of the values [unit]; None: what a hand can do"""
    constant: bool = False
    """whether all of them may be the same"""


class Read(NamedTuple):
    """What a file holds."""

    times: Array
    """since the segment's start, growing [s]"""
    values: Array
    """[deg or N]"""
    note: str
    """what was understood, in one line"""


@dataclass(frozen=True)
class _Table:
    """A file's rows below its header."""

    rows: Callable[[], Iterator[tuple[int, list[str]]]]
    """from the first on, with their line numbers"""
    below: int
    """line of the header, or the one before the first row"""
    delimiter: str
    time: int
    value: int
    width: int
    """cells that a row may have; 0: any number"""
    time_name: str
    value_name: str


def read_samples(content: bytes, keys: Keys, span: float) -> Read:
    """The samples of a file of which a segment of ``span`` [s] hears the start. ValueError with one line if not."""
    text, encoding = _decoded(content)
    table = _table(text, keys)
    said = [f'"{escaped(table.value_name)}" [{keys.unit}] over "{escaped(table.time_name)}"']
    rows, time_unit, value_unit, units_row = _units(table, keys)
    decimal = _decimal(table, rows, keys)
    lines, stamps, raw, dated, midnights = _numbers(table, rows, keys, decimal, time_unit)
    factor, stated = _time_factor(time_unit, keys, dated)
    scale = _scale(value_unit, keys)
    values = scale * raw + (keys.offset or 0.0)
    _check_values(lines, values, keys)
    _check_order(lines, stamps, table.time_name)
    times, shift = _placed(stamps, factor, keys, span)
    if not stated:
        _check_clock(stamps, times)
    times, values, averaged = _merged(times, values)
    _check_heard(times, values, span, keys, _Clock(stamps[0], bool(shift), stated, dated))
    if keys.unit == "deg" and keys.bounds is None:  # a force may jump, as in a step
        _check_rate(times, values)

    heard = int(np.count_nonzero((times >= 0.0) & (times <= span)))
    said[0] = f"{len(times)} samples of {said[0]}, from {times[0]:.6g} to {times[-1]:.6g} s"
    if heard < len(times):
        said.append(f"{heard} of them within the segment's {span:g} s")
    if averaged:
        said.append(averaged)
    if shift:
        said.append(f"the clock starts at {shift}, taken as 0 s")
    if dated:
        said.append("stamps are dates or times of day")
        if midnights:
            said.append(f"the clock passes midnight {midnights} time{'s' * (midnights > 1)}")
    elif factor != 1.0 or stated:
        said.append(f"time in {next(name for name, value in TIME_UNITS.items() if value == factor)}")
    else:
        said.append("time taken as seconds")
    if scale != 1.0 or keys.offset:
        said.append(f"values × {scale:g}" + (f" + {keys.offset:g}" if keys.offset else ""))
    form = {"\t": "tab", " ": "spaces"}.get(table.delimiter, f'"{table.delimiter}"')
    said.append(f'delimiter {form}, decimal "{decimal}"' + (", a row of units" if units_row else ""))
    if encoding != "UTF-8":
        said.append(encoding)
    return Read(times, values, "; ".join(said))


# --- text ------------------------------------------------------------------------------------------------------------


def _decoded(content: bytes) -> tuple[str, str]:
    """The text with \\n at the ends of its lines, and the name of its encoding."""
    marks = ((codecs.BOM_UTF8, "utf-8", "UTF-8"), (codecs.BOM_UTF16_LE, "utf-16-le", "UTF-16"),
             (codecs.BOM_UTF16_BE, "utf-16-be", "UTF-16"))  # fmt: skip
    codec, name = "utf-8", "UTF-8"
    if marked := next((known for known in marks if content.startswith(known[0])), None):
        mark, codec, name = marked
        content = content[len(mark) :]
    elif b"\0" in (head := content[:4000]):  # Latin letters as UTF-16 without a mark: every other byte is zero
        codec = "utf-16-le" if head[1::2].count(0) >= head[0::2].count(0) else "utf-16-be"
        name = "UTF-16"
    try:
        text = content.decode(codec)
    except UnicodeDecodeError:
        if codec != "utf-8":
            raise ValueError("is not a text file") from None
        text, name = content.decode("latin-1"), "Latin-1"
    if (odd := re.search(r"[\x00-\x08\x0e-\x1f\x7f-\x84\x86-\x9f]", text)) is not None:
        line = text.count("\n", 0, odd.start()) + 1
        raise ValueError(f"is not a text file: line {line} holds the character {shown(odd[0])}")
    return text.replace("\r\n", "\n").replace("\r", "\n").removeprefix("\ufeff"), name


def _lines(text: str) -> Iterator[str]:
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def _rows(text: str, delimiter: str, skip: int) -> Iterator[tuple[int, list[str]]]:
    """Rows that hold anything, stripped, with their line numbers; comments are rows that start with their mark."""
    lines = _lines(text)
    for _ in range(skip):
        next(lines, None)
    if delimiter == " ":
        for number, line in enumerate(lines, start=skip + 1):
            if cells := line.split():
                yield number, cells
        return
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    while True:
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise ValueError(f"line {skip + reader.line_num}: is not a row of cells: {error}") from None
        if row is None:
            return
        cells = [cell.strip() for cell in row]
        while cells and not cells[-1]:
            cells.pop()
        if cells:
            yield skip + reader.line_num, cells


# --- header ----------------------------------------------------------------------------------------------------------


def _named(cell: str) -> tuple[str, str]:
    """Name and unit of a header such as ``Force [N]``, ``t (ms)``, ``Zeit / s`` or ``time_ms``; unit empty if none."""
    if len(cell) > LONGEST_HEADER:
        return cell, ""
    cell = " ".join(cell.split())
    if match := re.fullmatch(r"(.+?)\s*(?:\[\s*(.*?)\s*\]|\(\s*(.*?)\s*\)|/\s*(\S+)|in\s+(\S+))", cell):
        return match[1], next(unit for unit in match.groups()[1:] if unit is not None)
    if (match := re.fullmatch(r"(.+)[_.]([^\W_]+)", cell)) and match[2].casefold() in (
        *_SPELT, *_FACTORS["deg"], *_FACTORS["N"], *_OTHER_UNITS,
    ):  # fmt: skip
        return match[1], match[2]
    return cell, ""


class _Headers(NamedTuple):
    """A row's cells as headers: as they are, in small letters, and without their units."""

    plain: list[str]
    small: list[str]
    bare: list[str]

    @classmethod
    def of(cls, cells: list[str]) -> "_Headers":
        return cls(cells, [cell.casefold() for cell in cells], [_named(cell)[0].casefold() for cell in cells])

    def find(self, wanted: str) -> list[int]:
        """Where ``wanted`` stands: as it is, or else in other letters, or else without its unit."""
        for form, name in ((self.plain, wanted), (self.small, wanted.casefold()), (self.bare, wanted.casefold())):
            if found := [k for k, cell in enumerate(form) if cell == name]:
                return found
        return []

    def find_time(self, wanted: str | None) -> list[int]:
        """Where the time stands: under ``wanted``, or else under the first name that means it."""
        return next((found for name in ((wanted,) if wanted else _TIME_NAMES) if (found := self.find(name))), [])


def _bare(cells: list[str]) -> list[str]:
    """Cells of a row without the mark of a comment, which may be a header."""
    first = _COMMENT.sub("", cells[0], count=1).strip() if _COMMENT.match(cells[0]) else cells[0]
    return [first, *cells[1:]] if first else cells[1:]


def _table(text: str, keys: Keys) -> _Table:
    """Where the samples stand: the first row that names both columns, under the one delimiter that shows it."""
    skip, candidates = keys.skip, DELIMITERS if keys.delimiter is None else (keys.delimiter,)
    body = _lines(text)
    for _ in range(skip):
        next(body, None)
    for line in body:
        if match := re.fullmatch(r'\s*"?sep=([,;\t| ])"?[;,\s]*', line, re.IGNORECASE):
            skip += 1
            if keys.delimiter is None:
                candidates = (match[1],)
        elif not line.strip():
            skip += 1
            continue
        break
    found, near, fault = list[_Table](), list[str](), ""
    for delimiter in candidates:
        if delimiter == " " and found:
            break  # blanks separate only where nothing else does
        try:
            table, headers = _under(text, delimiter, skip, keys)
        except ValueError as error:
            fault = fault or str(error)
            continue
        if table is not None:
            found.append(table)
        if len(headers) > len(near):
            near = headers
    if len(found) > 1:
        raise ValueError(f"may be separated by {' or '.join(shown(t.delimiter) for t in found)}; give delimiter")
    if found:
        return found[0]
    if fault:
        raise ValueError(fault)
    if not near:
        raise ValueError('has no column "time": it is empty')
    missing, key = (
        (keys.column, "column") if _Headers.of(near).find_time(keys.time_column)
        else (keys.time_column or "time", "time_column")
    )  # fmt: skip
    hint = f"give {key}"
    if all(_NUMBER.fullmatch(cell.replace(",", ".")) for cell in near):
        hint = 'there is no header: give time_column and column as numbers, such as "1" and "2"'
    elif keys.delimiter is None and len(near) == 1:
        hint = "give delimiter"
    columns = listed([escaped(cell) for cell in near[:20]])
    raise ValueError(f'has no column "{escaped(missing)}"; found: {columns}; {hint}')


def _under(text: str, delimiter: str, skip: int, keys: Keys) -> tuple[_Table | None, list[str]]:
    """The table as ``delimiter`` shows it, and the headers that come nearest to one."""
    near: list[str] = []
    numbers = [name for name in (keys.time_column, keys.column) if name is not None and name.isdecimal()]
    places = [int(name[:6]) - 1 for name in numbers]

    def rows() -> Iterator[tuple[int, list[str]]]:
        return _rows(text, delimiter, skip)

    for number, marked in rows():
        if number > _SEARCHED + skip:
            break
        cells = _bare(marked)
        if len(numbers) == 2 and _is_row(cells, places):
            time_name, value_name = (f"column {name}" for name in numbers)
            return _Table(rows, number - 1, delimiter, places[0], places[1], 0, time_name, value_name), cells
        headers = _Headers.of(cells)
        times, values = headers.find_time(keys.time_column), headers.find(keys.column)
        if times and values:
            for key, found in (("time_column", times), ("column", values)):
                if len(found) > 1:
                    which = listed([escaped(cells[k]) for k in found])
                    raise ValueError(f"line {number}: has {len(found)} columns that may be meant: {which}; give {key}")
            names = cells[times[0]], cells[values[0]]
            return _Table(rows, number, delimiter, times[0], values[0], len(cells), *names), cells
        if not near or times or values:
            near = cells
    return None, near


def _is_row(cells: Sequence[str], places: Sequence[int]) -> bool:
    return all(0 <= k < len(cells) and _NUMBER.fullmatch(cells[k].replace(",", ".")) for k in places)


# --- cells -----------------------------------------------------------------------------------------------------------


def _samples(table: _Table, after: int) -> Iterator[tuple[int, str, str]]:
    """Line number and the two cells of every row after line ``after``."""
    for number, cells in table.rows():
        if number <= after or _COMMENT.match(cells[0]):
            continue
        if table.width and len(cells) > table.width:
            raise ValueError(
                f"line {number}: has {len(cells)} cells, more than the {table.width} of its header; "
                "decimal commas? give delimiter and decimal"
            )
        yield (
            number,
            cells[table.time] if table.time < len(cells) else "",
            cells[table.value] if table.value < len(cells) else "",
        )


def _units(table: _Table, keys: Keys) -> tuple[int, str, str, bool]:
    """Last line that holds no samples, units of time and value (empty if not named), and whether a row names them."""
    time_unit, value_unit = _named(table.time_name)[1], _named(table.value_name)[1]
    first = next(_samples(table, table.below), None)
    if first is None or not first[1]:
        return table.below, time_unit, value_unit, False
    row = [cell.strip("[]() ") for cell in first[1:]]
    if row[0].casefold() not in _SPELT or _NUMBER.fullmatch(row[1].replace(",", ".")):
        return table.below, time_unit, value_unit, False
    header: str
    spelt: Mapping[str, object]
    for header, cell, spelt, key, given in (
        (time_unit, row[0], _SPELT, "time_unit", keys.time_unit),
        (value_unit, row[1], _factors(keys.unit), "scale", keys.scale),
    ):
        meant = [spelt.get(unit.casefold(), unit.casefold()) for unit in (header, cell)]
        if header and cell and meant[0] != meant[1] and given is None:
            raise ValueError(f"line {first[0]}: names {shown(cell)} as the unit where the header names "
                             f"{shown(header)}; give {key}")  # fmt: skip
    return first[0], row[0], row[1] or value_unit, True


def _decimal(table: _Table, after: int, keys: Keys) -> str:
    """The decimal mark: as given, or the only one there is."""
    if keys.decimal is not None:
        if keys.decimal == table.delimiter == "," and table.width == 0:
            raise ValueError('has "," as delimiter and as decimal mark; give another delimiter')
        return keys.decimal
    doubt = proof = None
    for number, *cells in _samples(table, after):
        for cell in cells:
            if "," in cell:
                if "." in cell:
                    raise ValueError(f"line {number}: {shown(cell)} has two kinds of marks; give decimal")
                if _GROUPED.fullmatch(cell):
                    doubt = doubt or (number, cell)
                else:
                    proof = proof or (number, cell)
            elif "." in cell and (comma := proof or doubt):
                raise ValueError(
                    f"line {number}: {shown(cell)} has a point where line {comma[0]} has a comma, {shown(comma[1])}; "
                    "give decimal"
                )
        if not (proof or doubt) and any("." in cell for cell in cells):
            # A point so far: any comma later is in doubt.
            for later, *others in _samples(table, number):
                if any("," in cell for cell in others):
                    raise ValueError(
                        f"line {later}: {shown(next(c for c in others if ',' in c))} has a comma where line {number} "
                        "has a point; give decimal"
                    )
            return "."
    if doubt and not proof:
        line, cell = doubt
        meant = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        raise ValueError(f"line {line}: {shown(cell)} may be {meant}; give decimal")
    return "," if proof else "."


def _numbers(
    table: _Table, after: int, keys: Keys, decimal: str, time_unit: str
) -> tuple[Sequence[int], Array, Array, bool, int]:
    """Line numbers, stamps as the file counts them and values; whether stamps are dates, and midnights between."""
    lines, stamps, values = array("q"), array("d"), array("d")
    origin: dt.datetime | None = None
    midnights = 0
    first_field = keys.time_unit or next(
        (unit for unit, form in _FIRST_FIELD.items() if re.fullmatch(form, time_unit.casefold())),
        _SPELT.get(time_unit.casefold(), ""),
    )
    group = "," if decimal == "." else "."
    grouped = re.compile(rf"[+-]?\d{{1,3}}(\{group}\d{{3}})+(\{decimal}\d*)?", re.ASCII)

    def number_in(line: int, cell: str, name: str) -> float:
        plain = cell.replace("\u2212", "-")
        if keys.decimal is not None and grouped.fullmatch(plain):
            plain = plain.replace(group, "")
        if decimal == ",":
            if "." in plain:
                raise ValueError(f'line {line}: {shown(cell)} has a point, but the decimal mark is ","; give decimal')
            plain = plain.replace(",", ".")
        if not _NUMBER.fullmatch(plain):
            if not cell:
                raise ValueError(f"line {line}: needs a number for {escaped(name)}; the cell is empty")
            if cell.lstrip("+-").casefold() in ("nan", "inf", "infinity"):
                raise ValueError(f"line {line}: needs finite numbers, not {shown(cell)}")
            raise ValueError(f"line {line}: needs a number for {escaped(name)}, not {shown(cell)}")
        found = float(plain)
        if not math.isfinite(found):
            raise ValueError(f"line {line}: needs finite numbers, not {shown(cell)}")
        return found

    for line, time_cell, value_cell in _samples(table, after):
        if not lines and not _NUMBER.fullmatch(time_cell.replace(",", ".")):
            origin = _date(line, time_cell, first_field)
        if origin is not None:
            date = _date(line, time_cell, first_field)
            if date is None or (date.tzinfo is None) != (origin.tzinfo is None):
                raise ValueError(f"line {line}: {shown(time_cell)} is no date or time as in the first row")
            stamp = (date - origin).total_seconds() + midnights * _DAY
            if stamps and stamp < stamps[-1] - 0.5 * _DAY and ":" in time_cell[:5]:
                midnights += 1
                stamp += _DAY
        else:
            stamp = number_in(line, time_cell, table.time_name)
        lines.append(line)
        stamps.append(stamp)
        values.append(number_in(line, value_cell, table.value_name))
    if not lines:
        raise ValueError("has no samples below its header")
    return lines, np.array(stamps), np.array(values), origin is not None, midnights


def _date(line: int, cell: str, first_field: str) -> dt.datetime | None:
    """A date with time as ISO 8601 writes it, or a clock hh:mm:ss, with a decimal comma too.

    A clock of two fields is read if the unit of the first one is known, ``min`` or ``h``.
    """
    cell = cell.replace(",", ".")
    if _TIMECODE.fullmatch(cell):
        raise ValueError(f"line {line}: {shown(cell)} has a third colon; frames or fractions after one are not "
                         "understood: write hh:mm:ss.fff, or give a column of seconds")  # fmt: skip
    if match := _CLOCK.fullmatch(cell):
        hours, minutes, seconds = match[1], match[2], f"{match[3]}{match[4] or ''}"
        if match[3] is None:
            if first_field not in _FIRST_FIELD:
                raise ValueError(f'line {line}: {shown(cell)} may be mm:ss or hh:mm; give time_unit = "min" or "h", '
                                 "the unit of its first field, or a column of seconds")  # fmt: skip
            second = f"{match[2]}{match[4] or ''}"
            hours, minutes, seconds = ("0", match[1], second) if first_field == "min" else (match[1], second, "0")
        past = dt.timedelta(hours=int(hours), minutes=float(minutes), seconds=float(seconds))
        cell = f"2000-01-01T00:00:00{match['zone'] or ''}"
    elif _DATE.fullmatch(cell):
        past = dt.timedelta()
    else:
        return None
    try:
        return dt.datetime.fromisoformat(cell) + past
    except ValueError:
        return None


# --- what the numbers mean -------------------------------------------------------------------------------------------


def _time_factor(unit: str, keys: Keys, dated: bool) -> tuple[float, bool]:
    """Seconds in a unit of the file's time, and whether file or scenario name it."""
    if dated:
        return 1.0, True
    if keys.time_unit is not None:
        return TIME_UNITS[keys.time_unit], True
    if not unit:
        return 1.0, False
    if unit.casefold() not in _SPELT:
        raise ValueError(f"names {shown(unit)} as the unit of time, which is not known; "
                         f"give time_unit ({', '.join(u for u in TIME_UNITS if u != 'µs')}), "
                         "or a column in one of these")  # fmt: skip
    return TIME_UNITS[_SPELT[unit.casefold()]], True


def _scale(unit: str, keys: Keys) -> float:
    """Factor from the file's values to the segment's unit."""
    if keys.scale is not None:
        return keys.scale
    factors = _factors(keys.unit)
    factor = factors.get(unit, factors.get(unit.casefold()))
    if unit and factor != 1.0:
        hint = f"give scale, in {keys.unit} per {escaped(unit)}" if factor is None else f"give scale = {factor:.12g}"
        raise ValueError(f"names {shown(unit)} as the unit of its values where unit says {keys.unit}; {hint}")
    return 1.0


def _check_values(lines: Sequence[int], values: Array, keys: Keys) -> None:
    unit = "" if keys.unit == "1" else f" {keys.unit}"
    low, high = keys.bounds or (-LARGEST[keys.unit], LARGEST[keys.unit])
    if len(bad := np.flatnonzero(~((values >= low) & (values <= high)))):
        k = int(bad[0])
        raise ValueError(f"line {lines[k]}: {values[k]:g}{unit} is not valid; values lie from {low:g} to {high:g}"
                         f"{unit}, after scale and offset")  # fmt: skip


def _check_order(lines: Sequence[int], stamps: Array, name: str) -> None:
    if len(far := np.flatnonzero(np.abs(stamps) > 1e20)):
        k = int(far[0])
        raise ValueError(f"line {lines[k]}: {escaped(name)} {stamps[k]:g} is no time; it lies from -1e20 to 1e20")
    if len(back := np.flatnonzero(np.diff(stamps) < 0.0)):
        k = int(back[0])
        raise ValueError(
            f"line {lines[k + 1]}: {escaped(name)} {stamps[k + 1]:.12g} lies before {stamps[k]:.12g} in line "
            f"{lines[k]}; samples must be in order of time"
        )


def _placed(stamps: Array, factor: float, keys: Keys, span: float) -> tuple[Array, str]:
    """Times since the segment's start [s], and the reading of the clock that was taken as 0, if it was shifted.

    A clock that starts within the segment counts from the segment's start; any other one has an origin of its own,
    and its first sample is the segment's start.
    """
    if keys.time_zero is not None:
        return (stamps - keys.time_zero) * factor, f"{keys.time_zero:.15g}"
    times = stamps * factor
    if times[-1] < 0.0 or times[0] >= span:
        return (stamps - stamps[0]) * factor, f"{stamps[0]:.15g}"
    return times, ""


def _check_clock(stamps: Array, times: Array) -> None:
    """Refuse a clock of unnamed unit that is known not to count seconds."""
    for name, (low, high) in _HUNDREDS.items():
        if low <= stamps[0] <= high:
            raise ValueError(f"counts its time from {stamps[0]:.15g} on, as if in 100 ns ({name}), which is not "
                             "understood; give a column of seconds")  # fmt: skip
    gaps = np.diff(times)
    if 2 * np.count_nonzero((gaps > 0.0) & (gaps < _NEAR)) > len(times):
        low, high = _SERIAL_DAYS
        days = ' = "d" if it counts the days of a spreadsheet' if low <= stamps[0] <= high else ""
        raise ValueError(f"has most of its {len(times)} samples less than {1e6 * CLOSEST:.0f} µs apart, were "
                         f"its time in seconds; give time_unit{days}")  # fmt: skip


def _merged(times: Array, values: Array) -> tuple[Array, Array, str]:
    """Samples with the same stamp, or less than 50 µs after it, as their mean; and what was averaged."""
    gaps = np.diff(times)
    if not np.any(gaps < _NEAR):
        return times, values, ""
    starts = array("q", [0])
    begun = float(times[0])
    for k, time in enumerate(times.tolist()):
        if time - begun >= _NEAR:
            starts.append(k)
            begun = time
    first = np.array(starts)
    counts = np.diff(first, append=len(times))
    close = bool(np.any((gaps > 0.0) & (gaps < _NEAR)))
    kind = f"time stamps less than {1e6 * CLOSEST:.0f} µs apart" if close else "a repeated time stamp"
    averaged = f"{int(np.sum(counts[counts > 1]))} with {kind} averaged"
    return times[first], np.add.reduceat(values, first) / counts, averaged


class _Clock(NamedTuple):
    """How a file's time was understood."""

    first: float
    """first stamp, as the file counts it"""
    shifted: bool
    stated: bool
    dated: bool


def _check_heard(times: Array, values: Array, span: float, keys: Keys, clock: _Clock) -> None:
    """Refuse a file of which the segment hears little or nothing, for then its clock or column was misunderstood."""
    inside = (times >= 0.0) & (times <= span)
    heard = len(np.unique(np.round(times[inside] / CLOSEST)))
    share = heard / len(times)
    lasts = f"its {len(times)} samples last from {times[0]:.6g} to {times[-1]:.6g} s, the segment {span:g} s"
    if clock.dated:
        help_ = "give time_zero, in seconds after the first stamp"
    elif keys.time_zero is not None:
        help_ = "give time_unit or another time_zero"
    elif times[0] != 0.0 and not clock.shifted:
        help_ = f"give time_zero, what the clock shows at the segment's start, such as {clock.first:.15g}, or time_unit"
    else:
        help_ = "give time_unit"
    if heard < 2:
        raise ValueError(f"would be heard in {heard} of its samples: {lasts}; {help_}")
    if keys.time_unit is None and share < (LITTLE if clock.stated else HALF):
        raise ValueError(f"would be heard in {heard} of its samples only: {lasts}; {help_}")
    if keys.constant:
        return
    if np.ptp(values) == 0.0:
        raise ValueError(f"holds {values[0]:g} {keys.unit} throughout; give another column, or hold that value")
    within = np.interp([0.0, span], times, values), values[inside]
    if np.ptp(np.concatenate(within)) == 0.0:
        raise ValueError(f"holds {within[1][0]:g} {keys.unit} as long as it is heard: {lasts}; give time_zero")


LITTLE, HALF = 0.1, 0.5
"""Least share of a file's samples that is heard where the unit of its time is named by the file, or by none."""


def _check_rate(times: Array, values: Array) -> None:
    rates = np.abs(np.diff(np.radians(values))) / np.diff(times)
    k = int(np.argmax(rates))
    if rates[k] > FASTEST:
        raise ValueError(
            f"moves from {values[k]:g} to {values[k + 1]:g} deg within {times[k + 1] - times[k]:.3g} s at "
            f"{times[k]:.6g} s, faster than {math.degrees(FASTEST):.0f} deg/s; give time_unit, or check the values"
        )
