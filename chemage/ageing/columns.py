"""Tables with named columns as people export them: one grammar of headings, and one of cells.

The words of a heading name a quantity and its role (the value, an error, a limit, a count). A cell holds a number with
its error and unit, where it has them.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise, zip_longest
from statistics import NormalDist
from typing import Any

from chemage.foundation.errors import (
    InputError,
    UnitError,
    nearest,
    shortened,
    shown,
)
from chemage.foundation.tables import Cell, Cells, lines_of
from chemage.foundation.units import convert

#: quantity -> words for it; case matters in words of one or two letters
QUANTITIES = {
    "hold_time": "t|time|hold|holding|waiting|contact time|ageing time|ageing time|zeit|haltezeit|kontaktzeit|wartezeit|"
    "standzeit|ruhezeit|alterungszeit",
    "friction": "F|F s|Fs|friction|reibung|haftreibung|reibkraft|reibungskraft|haftreibungskraft",
    "friction_coefficient": "mu|μ|mu s|μ s|coefficient|cof|reibwert|reibungszahl|reibkoeffizient|reibungskoeffizient|"
    "haftreibungszahl|haftreibungskoeffizient",
    "displacement": "displacement|displ|load point|loadpoint|load point displacement|loadpoint displacement|"
    "shear displacement|verschiebung",
    "offset": "offset|baseline|kinetic|sliding|dynamic|F k|Fk|mu k|μ k|gleitreibung|gleitreibungskraft|gleitreibungszahl",
    "value": "value|wert|messwert",
    "quantity": "quantity|größe",
    "load": "load|normal|F N|FN|Fn|F n|last|normalkraft|normallast|auflast",
    "temperature": "T|temp|temperature|temperatur",
    "curve": "curve|series|sample|label|kurve|reihe|messreihe|probe",
    "instrument": "instrument|lever|cantilever|tip|setup|rig|gerät|spitze|hebel",
}
#: what else words say of a column: its role beside the values themselves
ROLES = {
    "change": "delta|drop|rise|increase|change|zunahme|anstieg|änderung",
    "error": "error|errors|err|standard error|std error|std err|stderr|se|SE|s e|sem|s e m|sigma|σ|uncertainty|±|fehler|"
    "standardfehler|messfehler|unsicherheit|messunsicherheit",
    "plus": "+|plus|upper|high|up|obere|oberer|oben",
    "minus": "-|minus|lower|low|down|untere|unterer|unten",
    "interval": "ci|CI|confidence interval|limit|bound|grenze|konfidenzintervall|vertrauensbereich",
    "scatter": "std|sd|SD|s d|stdev|std dev|standard deviation|stabw|std abw|standardabw|standardabweichung|scatter|streuung",
    "count": "n|N|count|number|anzahl",
    "mean": "mean|average|mittelwert|mittelwerts|mittel|mittlere|mittlerer",
    "relative": "relative|rel|relativer",
    "unclear": "d F|dF|d mu|dmu|d μ|dμ",
    "": "peak|maximum|of|the|in|for|and|der|die|des|force|static|total|standard|run|trial|rep|replicate|repeat|no|nr|"
    "measurement|messung|lauf|wiederholung",
}
#: words of roles in one heading -> the role that they mean together
_TOGETHER = {
    "error minus": "minus",
    "error plus": "plus",
    "error relative": "relative",
    "interval minus": "lower",
    "interval plus": "upper",
    "minus": "lower",
    "plus": "upper",
    **{
        role: role
        for role in ("", "count", "error", "interval", "mean", "scatter", "unclear")
    },
}
#: roles of headings that may mean two things -> the question
QUESTIONS = {
    "unclear": 'may be an error or a difference; name it "error", "friction_drop" or "friction_coefficient_drop"',
    "interval": 'may be half or the whole of an interval; name its half "95 % error", or its ends "95 % upper", "95 % lower"',
    "inside": "has cells whose errors may be scatters; give standard errors, and name the column after the values alone",
    "log": "may be of base 10 or e; name it log10(...) or ln(...)",
}
_WORDS = {
    word: tag
    for tag, words in (QUANTITIES | ROLES).items()
    for word in words.split("|")
}


def _pattern(word: str) -> str:
    """Of a word of a heading: long ones also as parts of compounds."""
    text = re.escape(word) if len(word) < 3 else f"(?i:{re.escape(word)})"
    if len(word) > 3 or not word[0].isalpha():
        return text
    return rf"(?<![^\W\d_]){text}(?![^\W\d_])"


#: a word, or the number of a replicate
_TOKEN = re.compile(
    rf" ?(?:(?:(?<=[a-z])s)?({'|'.join(map(_pattern, sorted(_WORDS, key=len, reverse=True)))})|(\d{{1,4}}))"
)
#: the names of columns, for messages
NAMES = (
    "hold_time",
    "friction_drop",
    "friction_coefficient_drop",
    "value",
    "quantity",
    "error",
    "offset",
    "load",
    "temperature",
    "curve",
    "instrument",
)
#: quantities that a column of values may have, the rise of friction before the whole of it
VALUES = (
    "friction_drop",
    "friction_coefficient_drop",
    "value",
    "friction",
    "friction_coefficient",
)
#: roles of columns that say how far off values are
ERRORS = ("count", "error", "plus", "minus", "upper", "lower", "scatter")
#: lines among which the header is looked for, lines that it may have, and columns of one with several
_PREAMBLE, _DEEPEST, _FEW = 40, 3, 100
#: rows and columns of a table, characters of a name or a number, and ways to write the unit of a column
_ROWS, _COLUMNS, _LONGEST, _SPELLINGS = 100_000, 1000, 200, 100
_PLAIN_NUMBERS = "write decimals with a point and no marks of thousands"
#: of a number beyond
_LARGEST_LOG = 300.0
#: what people and programs write where there is no number
_MISSING = frozenset(
    "|nan|n/a|n.a.|n. a.|na|#n/a|#nv|#div/0!|#value!|#wert!|null|none|k.a.|k. a.|-|--|–|—|?".split(  # noqa: SIM905
        "|"
    )
)


# -- headings ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Heading:
    """What the heading of a column says."""

    text: str
    #: the quantity, "" where the heading has a role alone
    name: str
    #: "" of the values themselves, "mean", "error", "plus", "minus", "upper", "lower", "scatter" or "count"
    role: str = ""
    unit: str | None = None
    #: of the logarithms in the column; 0: it holds the numbers themselves, nan: not known
    base: float = 0.0
    #: how many standard errors are given; 0: not said
    sigmas: float = 0.0
    #: number of a replicate; "" where it has none
    index: str = ""
    #: of its cells in a row
    place: int = -1


_LOG = re.compile(r"(log_?\s?10|log₁₀|lg|ln|log)(?=[\s(\[_])[\s_]*", re.I)
_BASES = {"lg": 10.0, "ln": math.e, "log": math.nan}
#: a level of confidence, or a number of standard errors
_LEVEL = re.compile(
    r"([5-9]\d(?:[.,]\d)?)\s?%(?:[\s-]|$)|\b([123])[\s-]?(?=σ|sigma|s\.?d\b|std|stand|s\.?e)",
    re.I,
)
_NAME_AND_UNIT = re.compile(
    r"(?P<name>.*?)\s*(?:[(\[{](?P<inside>[^()\[\]{}]*)[)\]}]|,\s*(?P<after>\S+)|/\s*(?P<below>\S+))"
)


@lru_cache(maxsize=4096)
def heading_of(text: str) -> Heading | None:
    """What a heading says; None where its words are not known."""
    whole = text = " ".join(text.strip(' "*').split())
    if text in ("", "+", "-") or len(text) > _LONGEST:
        return None
    if (written := re.fullmatch(r"(.*\S) in (\S+)", text)) and _is_unit(written[2]):
        text = f"{written[1]} ({written[2]})"
    base = sigmas = 0.0
    if log := _LOG.match(text):
        base = _BASES.get(log[1].lower(), 10.0)
        text = _unwrapped(text[log.end() :])
    text, unit = _parted(text)
    if base and unit and (log := _LOG.match(unit)):
        unit = unit[log.end() :]
    if level := _LEVEL.search(text):
        share = float((level[1] or "50").replace(",", ".")) / 100
        sigmas = float(level[2] or NormalDist().inv_cdf((1 + share) / 2))
        text = text[: level.start()] + text[level.end() :]
    text, sign, inside = re.sub(r"(?<=\S) ?\+ ?/? ?-", "±", text).partition("±")
    if sign and not text:
        text, inside = sign, ""
    found = _meaning(text)
    if inside and found and (_meaning(inside) or [""])[:2] != ("", "error"):
        found = found[0], "inside", found[2]
    if found is None and unit is None and "_" in text:  # hold_time_s
        text, _, unit = text.rpartition("_")
        found = _meaning(text)
    if not found or not any(found[:2]):
        return None
    name, role, index = found
    if (base and (name, role) != ("hold_time", "")) or (
        role == "relative" and unit != "%"
    ):
        return None
    role = {"relative": "error"}.get(role, role)
    return Heading(whole, name, role, unit_of(unit, name), base, sigmas, index)


def _meaning(text: str) -> tuple[str, str, str] | None:
    """Quantity, role and number of a replicate that words say; None where one of them is not known."""
    tags, index, at = set[str](), "", 0
    text = re.sub("[Δ∆]|delta", " delta ", text.replace("µ", "μ"), flags=re.I)
    text = re.sub(r"\+ ?/? ?-", "±", text)
    text = re.sub(r"(?:[\s_.:#'\"()\[\]]|(?<=\w)-(?=\w))+", " ", text).strip()
    while at < len(text):
        if (token := _TOKEN.match(text, at)) is None or (token[2] and index):
            return None
        word, index, at = token[1] or "", index or token[2] or "", token.end()
        tags.add(_WORDS.get(word, _WORDS.get(word.casefold(), "")))
    return _resolved(tags - {""}, index)


def _resolved(tags: set[str], index: str) -> tuple[str, str, str] | None:
    names, roles = tags & QUANTITIES.keys(), tags - QUANTITIES.keys()
    if "offset" in names:
        names -= {"friction", "friction_coefficient"}
    if "friction_coefficient" in names:
        names -= {"friction"}
    if len(names) > 1:  # of a sample, of a tip
        names -= {"curve", "instrument"}
    if len(names) > 1 or not (tags or index):
        return None
    name = next(iter(names), "")
    if "change" in roles:
        name, roles = f"{name}_drop", roles - {"change"}
        if name not in VALUES:
            return None
    if roles & {"error", "scatter", "count"}:
        roles -= {"mean"}
    role = _TOGETHER.get(" ".join(sorted(roles)))
    return None if role is None else (name, role, index)


def _unwrapped(text: str) -> str:
    """The text without the brackets that it begins with and those that close them."""
    depth = 0
    for at, mark in enumerate(text):
        depth += (mark in "([") - (mark in ")]")
        if not depth:
            return text[1:at] + text[at + 1 :] if at else text
    return text


def _parted(text: str) -> tuple[str, str | None]:
    """A heading as a name and its unit, in brackets, or after a comma or a slash."""
    found = _NAME_AND_UNIT.fullmatch(text)
    if found is None or text in ("+/-", "+ / -"):
        return text, None
    return found["name"], (found[found.lastgroup or 0]).strip()


def _joined(above: str, below: str) -> str:
    """A heading of two lines, of which the lower one may be a unit."""
    if not above or not below:
        return above or below
    (head, unit), (more, own) = _parted(above), _parted(below)
    if _is_unit(below) and unit is None:
        return f"{head} ({below.strip('()[]{} ')})"
    unit = own or unit
    return f"{head} {more}" + (f" ({unit})" if unit else "")


def _stacked(lines: Sequence[Sequence[Cell]]) -> list[str]:
    """The headings of several lines as one; a name stands also for empty cells to its right, as merged cells do."""
    texts: list[str] = []
    for line in lines:
        name, joined = "", []
        for above, cell in zip_longest(texts, line, fillvalue=""):
            below = str(cell)[: _LONGEST + 1]
            name = above or ("" if _is_unit(below) else name)
            joined.append(_joined(name, below))
        texts = joined
    return texts


def _is_unit(text: str) -> bool:
    return text in ("1", "N") or (
        len(text) < 12 and _meaning(_parted(text)[0]) is None
    )


def _textual(cells: Sequence[Cell]) -> bool:
    """Whether a line holds words and no numbers; 1 may be a unit."""
    texts = {str(cell) for cell in cells[:_COLUMNS]} - {"", "1"}
    return bool(texts) and not any(map(_is_number, texts))


def _header(lines: Sequence[Cells]) -> tuple[int, int, list[Heading | None]]:
    """First line, number of lines and headings of the header: of the first lines those that name most columns."""
    best = 0, 1, [heading_of(str(cell)) for cell in lines[0][2][:_COLUMNS]]
    most = (1, 0, 0)
    for first in range(min(len(lines), _PREAMBLE)):
        for depth in range(1, _DEEPEST + 1):
            part = [cells for _, _, cells in lines[first : first + depth]]
            if len(part) < depth or not _textual(part[-1]):
                break
            if depth > 1 and len(part[0]) > _FEW:
                break
            found = [heading_of(text) for text in _stacked(part)[:_COLUMNS]]
            there = [one for one in found if one]
            units = sum(one.unit is not None for one in there)
            if (score := (len(there), units, -depth)) > most:
                most, best = score, (first, depth, found)
    return best


# -- cells ------------------------------------------------------------------------------------------------------------

_DIGITS = r"(?:\d+(?:[.,]\d+)*|[.,]\d+)(?:[eE][-+]?\d+)?"
_UNIT = r"(?:[^\W\d_]|[°%])[^±+]*?"
_CELL = re.compile(
    rf"\(?(?P<value>[-+]?{_DIGITS}[.,]?)(?:\((?P<last>\d{{1,4}})\))?\s*(?P<unit>{_UNIT})?\s*"
    rf"(?:(?:±\s*(?P<error>{_DIGITS})|\(?\+\s*(?P<plus>{_DIGITS})\s*[/,;]?\s*-\s*(?P<minus>{_DIGITS})\)?)\s*\)?\s*"
    rf"(?P<after>{_UNIT})?)?\s*\)?\s*[*†‡§]*"
)
_CLOCK = re.compile(r"(\d{1,5}):([0-5]\d):([0-5]\d(?:[.,]\d*)?)")
_POWER = re.compile(r"(?:(?<=\d)\s*[×x·*]\s*|^)10\s?\^\s?\(?([-+]?\d+)\)?", re.I)
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")


def _plain(text: str) -> str:
    """A number as a text has it, with e for powers of ten."""
    if "+" in text:
        text = re.sub(r"\+ ?/? ?-", "±", text)
    if not text.isascii() or "10^" in text:
        text = re.sub(
            "10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+)",
            lambda power: f"10^{power[1].translate(_SUPERSCRIPTS)}",
            text,
        )
        text = _POWER.sub(
            lambda power: f"{'' if power.start() else 1}e{power[1]}", text
        )
    return text


@lru_cache(maxsize=4096)
def _matched(text: str) -> re.Match[str] | None:
    return _CELL.fullmatch(_plain(text)) if len(text) <= _LONGEST else None


def _is_number(cell: Cell) -> bool:
    return not isinstance(cell, str) or bool(
        _matched(cell) or _CLOCK.fullmatch(cell)
    )


def is_missing(cell: Cell) -> bool:
    """Whether a cell says that there is no number."""
    return cell.casefold() in _MISSING if isinstance(cell, str) else cell != cell


@dataclass(frozen=True)
class ColumnTable:
    """The header and the rows of a table."""

    #: quantity, or role of a column of errors -> its heading, or those of replicates
    columns: dict[str, tuple[Heading, ...]]
    #: where the header is, in words
    where: str
    #: number of the line, where it is in words, and its cells, one for each column
    rows: list[Cells]
    #: what was left out or understood, for users
    notes: tuple[str, ...] = ()
    #: mark of decimals
    decimal: str = "."

    def number(
        self, row: Cells, name: str, target: str, of: float | None = None
    ) -> float:
        """The finite number of a column in a row, in the unit ``target``; "" for pure numbers. An error may be a share
        of the value ``of``.

        Raises
        ------
        InputError
            The cell holds none, or no unit says what it is.
        """
        one = self.columns[name][0]
        value, error = self.measured(row, name, one, target, of)
        if error is not None:
            raise InputError(
                f"{row[1]}, column {name}: {shown(row[2][one.place])} has an error, which only values have"
            )
        return value

    def measured(
        self,
        row: Cells,
        name: str,
        one: Heading,
        target: str,
        of: float | None = None,
    ) -> tuple[float, float | None]:
        """A number and the standard error that its cell states, both in the unit ``target``."""
        where, cell = f"{row[1]}, column {name}", row[2][one.place]

        def converted(number: float, own: str | None = None) -> float:
            unit = unit_of(own, name) or one.unit
            if one.base:
                number = one.base**number if number < _LARGEST_LOG else math.inf
            if not math.isfinite(number):
                raise InputError(
                    f"{where}: {shown(cell)} is not a finite number; leave that row out"
                )
            if unit == "%" and of is not None:
                return number / 100 * abs(of)
            return in_unit(number, unit, name, target, where if own else self.where)

        if not isinstance(cell, str):
            return converted(float(cell)), None
        if target == "s" and (clock := _CLOCK.fullmatch(cell)):
            hours, minutes, seconds = map(self._float, clock.groups())
            return 3600 * hours + 60 * minutes + seconds, None
        if (match := _matched(cell)) is None:
            lost = is_missing(cell) or cell.casefold() in ("inf", "-inf")
            remedy = (
                "fill in the number, or leave that row out"
                if lost
                else _PLAIN_NUMBERS
            )
            raise InputError(
                f"{where}: {shown(cell)} is not a {'finite ' * lost}number; {remedy}"
            )
        number, after = self._float(match["value"]), match["after"]
        sides = [
            self._float(text)
            for text in match.group("error", "plus", "minus")
            if text
        ]
        if match["last"]:  # 12.3(4): of the last digits
            decimals = len(match["value"].partition(self.decimal)[2])
            sides = [int(match["last"]) / 10**decimals]
        # 12 ± 3 %, but not (12 ± 3) %
        share = after == "%" and cell[0] != "(" and one.unit != "%"
        unit = match["unit"] or (None if share else after)
        value = converted(number, unit)
        if not sides:
            return value, None
        error = sum(sides) / len(sides)
        return value, error / 100 * abs(value) if share else converted(error, unit)

    def _float(self, text: str) -> float:
        return float(text.replace(self.decimal, "."))


def unit_of(text: str | None, name: str) -> str | None:
    """The unit that is meant in a column of this name, as :mod:`chemage.foundation.units` has it."""
    if text is None:
        return None
    text = " ".join(text.replace("\u03bc", "u").replace("\u00b5", "u").split())
    if name == "temperature" and (
        match := re.fullmatch(
            r"(?:°|deg|º|grad)?\s*(C|F|celsius|fahrenheit)|(℃)", text, re.I
        )
    ):
        return "degF" if (match[1] or "C")[0] in "fF" else "degC"
    return _SPELLED.get(text.casefold().rstrip("."), text)


_SPELLED = {
    other: unit
    for unit, others in {
        "": "-|–|—|1",
        "s": "sec|secs|sek|sekunde|sekunden",
        "min": "min|mins|minute|minuten",
        "h": "hr|hrs|std|stunde|stunden",
        "day": "d|tag|tage",
        "um": "micron|microns|mikrometer",
        "%": "percent|prozent",
    }.items()
    for other in others.split("|")
}


def in_unit(
    value: float, unit: str | None, name: str, target: str, where: str
) -> float:
    """A number of a column in the unit ``target``; "" for pure numbers.

    Raises
    ------
    UnitError
        The unit is missing, or another quantity's.
    """
    if unit in (None, ""):
        if target:
            raise UnitError(
                f"{where}: the column {name} has no unit; add that of its numbers in brackets, such as {name} ({target})"
            )
        return value
    try:
        zero, one = _line(unit, target)
    except UnitError as error:
        raise UnitError(f"{where}: the column {name} ({unit}): {error}") from None
    return zero + value * (one - zero) if zero else value * one


@lru_cache(maxsize=256)
def _line(unit: str, target: str) -> tuple[float, float]:
    """What 0 and 1 of ``unit`` are in ``target``: zeros of temperatures differ."""
    one = convert(f"1 {unit}", target)
    return convert(f"0 {unit}", target), one


# -- tables -----------------------------------------------------------------------------------------------------------


def read_columns(
    source: Any, names: Collection[str], example: str, sheet: str | None = None
) -> ColumnTable:
    """Read a table with named columns: a text file, an Excel file (.xlsx) or a data frame.

    Of text, commas, semicolons, tabs or blanks separate the columns, and UTF-8, UTF-16 and Windows code pages are read.
    Decimals have a point or a comma, the same one everywhere; what could be a thousand or a decimal is refused. The
    lines that name most columns, at most three below each other, are the header; units stand in brackets, after a comma
    or a slash, at the end of the name after ``_``, in the line below the header, or with the numbers. Columns with
    other names, and lines without numbers, are left out.

    Parameters
    ----------
    names
        Quantities and roles of the columns that are wanted.
    example
        A header for messages.
    sheet
        Of an Excel file; default: the only one with hold times.

    Raises
    ------
    StoreError
        The file cannot be read as text.
    InputError
        It is empty, or a line does not have the columns; names line and column, and the remedy.
    """
    name, lines, notes = lines_of(source, _named, sheet)
    if not lines:
        raise InputError(
            f"{name}: there is nothing in it; the first line names the columns, such as {example}"
        )
    first, depth, found = _header(lines)
    if first:
        notes.append(
            f"{first} line{'s' * (first > 1)} before the names of the columns left out"
        )
    where, rest = lines[first][1], lines[first + depth :]
    texts = _stacked([cells for _, _, cells in lines[first : first + depth]])
    if len(rest) > _ROWS or len(texts) > _COLUMNS:
        raise InputError(
            f"{where}: {len(rest)} rows below {len(texts)} columns; a table has at most {_ROWS} rows and {_COLUMNS} "
            "columns: leave out what is not needed"
        )
    columns, more = _columns(texts, found, names, where, example)
    rows, remarks = [], []
    for number, at, cells in rest:
        if any(map(_is_number, cells)):
            rows.append((number, at, _row(cells, len(texts), at)))
        else:
            remarks.append(" ".join(str(cell) for cell in cells if cell != ""))
    if remarks:
        notes.append(
            f"{len(remarks)} line{'s' * (len(remarks) > 1)} without numbers left out: "
            + shortened("; ".join(remarks), 120)
        )
    decimal = _decimal(
        rows, [one.place for taken in columns.values() for one in taken]
    )
    return ColumnTable(columns, where, rows, (*notes, *more), decimal)


def _named(lines: Sequence[Cells]) -> int:
    """How many columns lines name, with that of hold times; else 0."""
    found = [one for one in _header(lines)[2] if one] if lines else []
    bases = [one.base for one in found if (one.name, one.role) == ("hold_time", "")]
    return len(found) if bases and bases.count(0) < 2 else 0


def _columns(
    texts: Sequence[str],
    found: Sequence[Heading | None],
    names: Collection[str],
    where: str,
    example: str,
) -> tuple[dict[str, tuple[Heading, ...]], list[str]]:
    there: dict[str, list[Heading]] = {}
    for place, (text, one) in enumerate(zip(texts, found, strict=True)):
        if one is None:
            _check_unknown(text, place, where, example)
        elif question := QUESTIONS.get("log" if math.isnan(one.base) else one.role):
            raise InputError(
                f"{where}: column {place + 1}, {shown(text)}, {question}"
            )
        key = "" if one is None else _key(one)
        if key in names and one:
            there.setdefault(key, []).append(replace(one, place=place))
    columns = {
        name: _taken(name, several, where) for name, several in there.items()
    }
    useless: set[str] = set()
    if any(len(taken) > 1 for taken in columns.values()):
        useless |= {*ERRORS}  # they follow from the replicates
    if columns.keys() & VALUES[:3]:
        useless |= {*VALUES[3:], "offset"}
    columns = {
        name: taken for name, taken in columns.items() if name not in useless
    }
    used = [one.place for taken in columns.values() for one in taken]
    left = [text for place, text in enumerate(texts) if text and place not in used]
    given = next(
        (columns[name][0].unit for name in VALUES if name in columns), None
    )
    for name in columns.keys() & ERRORS[1:]:  # in the unit of the values
        (one,) = columns[name]
        columns[name] = (
            replace(one, unit=given if one.unit is None else one.unit),
        )
    read = [
        f"{one.text} as {name}"
        for name, (one, *_) in columns.items()
        if not re.sub(r"[\s_]+", "_", one.text.lower()).startswith(name)
    ]
    notes = [f"read {', '.join(read)}"] if read else []
    if left:
        notes.append(
            f"{len(left)} column{'s' * (len(left) > 1)} left out: {shortened(', '.join(left), 120)}"
        )
    return columns, notes


def _key(one: Heading) -> str:
    """The name under which a column is wanted: its quantity, or the role of errors of the values."""
    if one.role in ("", "mean"):
        return one.name
    return one.role if one.name in ("", *VALUES) else ""


def _check_unknown(text: str, place: int, where: str, example: str) -> None:
    """Refuse a heading that is a number, or the name of a column with a slip of the pen."""
    head = re.sub(r"[\s_]+", " ", re.sub(r"[(\[,/].*", "", text)).strip()
    head = head.lower().replace(" ", "_")
    if head.endswith("_half_width"):
        raise InputError(
            f"{where}: column {place + 1}, {shown(text)}, is of means that chemage printed, without the correlation of "
            "their errors; give the file of the result itself"
        )
    number = _matched(text) is not None
    if number or difflib.get_close_matches(head, NAMES, n=1, cutoff=0.7):
        raise InputError(
            f"{where}: column {place + 1} is {shown(text)}{'' if number else nearest(head, NAMES)}; the columns are "
            f"{', '.join(NAMES)}, named on the first line, such as {example}"
        )


def _taken(name: str, several: list[Heading], where: str) -> tuple[Heading, ...]:
    """The columns of one name that are read: no means beside others, no logarithms beside times, all replicates."""
    several = [one for one in several if one.role != "mean"] or several
    several = [one for one in several if not one.base] or several
    indices = sorted(int(one.index or 0) for one in several)
    steps = {later - earlier for earlier, later in pairwise(indices)}
    alike = len({one.unit for one in several}) == 1 and steps in ({0}, {1})
    if len(several) > 1 and not (alike and name in VALUES):
        raise InputError(
            f"{where}: the column {name} is there twice; keep one, or number replicates 1, 2, ..."
        )
    return tuple(several)


def _row(cells: list[Cell], columns: int, where: str) -> list[Cell]:
    while len(cells) > columns and cells[-1] == "":
        cells = cells[:-1]
    if len(cells) != columns:
        more = ""
        if len(cells) > columns:
            more = "; separate columns by semicolons or tabs where decimals have a comma, and quote texts with blanks"
        raise InputError(
            f"{where}: {len(cells)} values under {columns} columns{more}"
        )
    return cells


def _decimal(rows: Sequence[Cells], places: Sequence[int]) -> str:
    """The mark of decimals, a comma or a point; what could be thousands, or mixes both, is refused."""
    sure: dict[str, str] = {}
    unsure: dict[str, tuple[str, str]] = {}
    for place in places:
        texts = [(at, cells[place]) for _, at, cells in rows]
        matches = [
            (at, _matched(cell)) for at, cell in texts if isinstance(cell, str)
        ]
        column = [
            (at, text)
            for at, match in matches
            if match
            for text in match.group("value", "error", "plus", "minus")
            if text
        ]
        if len({match["unit"] for _, match in matches if match}) > _SPELLINGS:
            raise InputError(
                f"{texts[0][0]}: a column with more than {_SPELLINGS} units; write one above the column"
            )
        whole = any(text.lstrip("+-").isdigit() for _, text in column)
        for at, text in column:
            if sum(text.count(mark) for mark in ",.") > 1:
                raise InputError(
                    f"{at}: {text} has marks of thousands; {_PLAIN_NUMBERS}"
                )
            for mark in (mark for mark in ",." if mark in text):
                if re.fullmatch(rf"[+-]?[1-9]\d{{0,2}}[{mark}]\d{{3}}", text) and (
                    whole or mark == ","
                ):
                    unsure[mark] = at, text
                else:
                    sure[mark] = at
    for mark, (at, text) in unsure.items():
        if mark not in sure:
            other = f"{text.replace(mark, '')} or {text.replace(mark, '.')}"
            raise InputError(f"{at}: {text} may be {other}; {_PLAIN_NUMBERS}")
    if len(sure) > 1:
        raise InputError(
            f"{sure[',']}: it has a decimal comma, where others have a point; {_PLAIN_NUMBERS}"
        )
    return next(iter(sure), ".")
