"""Every exception chemage raises on purpose, and how values are shown in messages.

ChemageError
├── InputError           a value the user gave is wrong: names the field, the value and the remedy
│   ├── UnitError        a string with an unknown unit or the wrong dimension
│   ├── UnknownKindError no installed plugin offers that kind
│   ├── MissingError     a library that chemage can do without is needed and not installed
│   └── SceneError       a scene file is wrong; carries the path of the field in the file
├── PluginError          a plugin is broken, or two of one name claim one kind
├── ConvergenceError     a contact solver stopped short of its tolerance; carries the residual history
├── StoreError           a file is missing, foreign, or already there
│   ├── AbsentError      there is no such file
│   └── DamagedError     what a file holds is not what was written
└── ExecutorError        the workers of a sweep cannot be started, or do not answer
    └── WorkerLost       a worker died with a task, again and again
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Sequence
from contextlib import suppress
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from chemage.foundation.limits import not_modelled

if TYPE_CHECKING:
    from pydantic import ValidationError

#: words as similar as this differ by typing errors
_TYPING = 0.8

#: control characters, halves of surrogate pairs, and marks that reorder what follows on the screen
_HARMFUL = re.compile(
    "[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff\\ufeff]"
)


def shortened(value: object, most: int = 80) -> str:
    """``value`` as text of at most ``most`` characters."""
    text = str(value)
    return text if len(text) <= most else text[: most - 3] + "..."


def shown(value: object, most: int = 80) -> str:
    """``repr(value)`` in one line of at most ``most`` characters, also of values that have none, such as lists in
    themselves."""
    try:
        text = repr(value)
        return shortened(" ".join(text.split()) if "\n" in text else text, most)
    except (
        Exception
    ):  # nested too deeply, a whole number of too many digits, or a faulty __repr__
        return f"a {type(value).__name__}"


def printable(text: str) -> str:
    """A text with control characters as escapes, so that a terminal prints and never obeys them.

    Line feeds and tabs stay; terminal escapes, carriage returns and marks that reorder text do not.
    """
    # bytes of the name of a file, in another encoding than that of the terminal
    with suppress(UnicodeError):
        text = text.encode(errors="surrogateescape").decode()
    return _HARMFUL.sub(
        lambda letter: letter[0].encode("unicode_escape", "surrogatepass").decode(),
        text,
    )


class ChemageError(Exception):
    """Base of everything chemage raises on purpose; the command line prints it without a traceback."""


class InputError(ChemageError, ValueError):
    """A value the user gave is wrong. ``problems`` lists ``(field, message)`` where several fields were checked."""

    def __init__(
        self, message: str, problems: Sequence[tuple[str, str]] = ()
    ) -> None:
        super().__init__(message)
        self.problems = list(problems)

    @classmethod
    def of(
        cls, field: str, value: object, problem: str, remedy: str = ""
    ) -> InputError:
        """The standard wording: ``field = value: problem; remedy``."""
        return cls(
            f"{field} = {shown(value)}: {problem}"
            + (f"; {remedy}" if remedy else "")
        )


class UnitError(InputError):
    """A string with an unknown unit, or a quantity of the wrong dimension."""


class UnknownKindError(InputError):
    """No installed plugin offers the kind that was given."""


class MissingError(InputError, ImportError):
    """A library that chemage can do without is needed and not installed; the message names the extra that has it."""


class SceneError(InputError):
    """A scene is wrong. ``problems`` is a list of ``(path, message)``."""

    def __init__(self, source: str, problems: Sequence[tuple[str, str]]) -> None:
        self.source = source
        lines = [
            f"  {path}: {message}" if path else f"  {message}"
            for path, message in problems
        ]
        super().__init__(
            f"{source} is not a valid scene:\n" + "\n".join(lines), problems
        )

    def __reduce__(
        self,
    ) -> tuple[type[SceneError], tuple[str, list[tuple[str, str]]]]:
        return type(self), (self.source, self.problems)


class PluginError(ChemageError):
    """A plugin could not be loaded, or clashes with another."""


class ConvergenceError(ChemageError):
    """A contact solver stopped short of its tolerance.

    ``history`` holds the residual of every iteration, ``residual`` the last, ``tolerance`` the goal.
    """

    def __init__(
        self,
        message: str,
        *,
        history: Sequence[float] = (),
        residual: float = float("nan"),
        tolerance: float = float("nan"),
    ) -> None:
        super().__init__(message)
        self.history = list(history)
        self.residual = residual
        self.tolerance = tolerance


class StoreError(ChemageError, OSError):
    """A file is missing, not one of ours, or already there."""


class AbsentError(StoreError, FileNotFoundError):
    """There is no such file."""


class DamagedError(StoreError):
    """What a file holds is not what was written to it."""


class ExecutorError(ChemageError):
    """The workers of a sweep cannot be started, or do not answer."""


class WorkerLost(ExecutorError):
    """A worker died while it worked on a task, as often as it was tried."""


class PlanWarning(UserWarning):
    """What a user should know of a run before it begins, as ``chemage check`` says it."""


def optional_module(name: str, extra: str) -> Any:
    """Import the library ``name``, which ``pip install 'chemage[extra]'`` installs.

    Raises
    ------
    MissingError
        It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise MissingError(
            f"{name} is not installed; run: pip install 'chemage[{extra}]'"
        ) from None


def imported(target: str, where: str = "") -> Any:
    """The object that a plugin names as ``"module:object"``.

    Raises
    ------
    PluginError
        It cannot be imported; the message begins with ``where``.
    """
    try:
        return resolve_name(target)
    except Exception as error:
        problem = f"{target} cannot be imported: {type(error).__name__}: {error}"
        raise PluginError(f"{where}: {problem}" if where else problem) from error


#: of a name that a model does not have
NO_OPTION = "no such option"


def explain(error: ValidationError) -> list[tuple[str, str]]:
    """Pydantic's error as ``(path, message)`` pairs in plain words."""
    problems = []
    for item in error.errors(include_url=False):
        path = ".".join(map(str, item["loc"]))
        message = item["msg"].removeprefix("Value error, ")
        value = item.get("input")
        if item["type"] == "extra_forbidden":
            message = NO_OPTION
        elif item["type"] == "missing":
            message = "is required"
        elif isinstance(value, int | float | str | bool):
            # many messages begin with the value already; that 0 is in "greater than 0" does not count
            begins = message.startswith((shown(value), f'"{value}"'))
            message = message if begins else f"{shown(value)}: {message}"
        problems.append((path, message))
    return problems


def in_lines(problems: Sequence[tuple[str, str]]) -> str:
    """``(path, message)`` pairs as one text."""
    return "; ".join(
        f"{path}: {message}" if path else message for path, message in problems
    )


def nearest(word: str, known: Sequence[str]) -> str:
    """``" (did you mean 'x'?)"`` when a known word is close, else nothing; of what chemage does not model, that."""
    import difflib

    match = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    likely = (
        match and difflib.SequenceMatcher(None, word, match[0]).ratio() > _TYPING
    )
    if not likely and (answer := not_modelled(word)):
        return f" ({answer})"
    return f" (did you mean {match[0]!r}?)" if match else ""
