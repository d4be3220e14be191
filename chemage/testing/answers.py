"""What a component answers to a set of questions of its role, each of which differs from another in one thing; and the
checks of every component that follow from that: options count, and nothing depends on what was asked before."""

from __future__ import annotations

import atexit
import inspect
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cache, partial
from itertools import islice
from threading import Condition
from typing import Any
from unittest.mock import patch

import numpy as np

from chemage.ageing.methods import AgeingMethod
from chemage.foundation.components import Component
from chemage.foundation.outputs import recording
from chemage.foundation.records import Record
from chemage.kinetics.role import Engine
from chemage.plugins import registry
from chemage.testing.checks import (
    CHECKS,
    LIMIT,
    Checks,
    Questions,
    is_number,
    require,
)

#: lines after which threads take turns, and packages in which they do not
TURNS, OURS = 100, ("chemage", "numpy", "pydantic", "numba")


def _answered(component: Component, ask: Callable[[Any], Any]) -> list[Any]:
    """What the component gives, or the name of the error that it raises, and what it records."""
    with recording() as block:
        try:
            given = ask(component)
        except Exception as error:
            given = type(error).__name__
    return [given, {name: one.declared.values for name, one in block.items()}]


def answer(component: Component, ask: Callable[[Any], Any]) -> bytes:
    """What the component gives and records, or the error that it raises, as bytes."""
    return as_bytes(_answered(component, ask))


def as_bytes(value: Any) -> bytes:
    """Arrays, records and what holds them, so that equal bytes mean equal values."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Record):
        value = value.todict()
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind != "O":
        return f"{value.dtype}{value.shape}".encode() + value.tobytes()
    if isinstance(value, Mapping):
        value = [[name, value[name]] for name in sorted(value, key=str)]
    if isinstance(value, list | tuple):
        return f"[{len(value)}".encode() + b"".join(map(as_bytes, value))
    return repr(value).encode() + b";"


def questions_of(component: Component, inputs: Mapping[str, Any]) -> Questions:
    """All questions of the role of a component."""
    for checks in CHECKS.get(component.role, ()):
        yield from checks(component).questions(**inputs)


def independent_calls(checks: Checks[Any], **inputs: Any) -> None:
    """The same is answered to the same, asked again in the opposite order or at the same time, and what was given stays
    as it was. Of an engine that uses several threads itself nothing is asked at the same time."""
    component = checks.component
    asked = [ask for _, ask in islice(questions_of(component, inputs), 6)]
    ask = partial(answer, component)
    before, held, first = _given(asked), [], []
    for one in asked:
        held.append(_answered(component, one))
        first.append(as_bytes(held[-1]))
    require(
        list(map(ask, asked[::-1])) == first[::-1],
        "a second call gave another result",
    )
    require(
        list(map(as_bytes, held)) == first,
        "a later call changed what an earlier one returned",
    )
    if not isinstance(component, Engine) or component.concurrency() == 1:
        turns, count = _Turns(ask, 3), range(3)
        with ThreadPoolExecutor(3) as pool:
            orders = [asked[k:] + asked[:k] for k in count]
            concurrent = list(pool.map(turns.answers, count, orders))
        require(
            concurrent == [first[k:] + first[:k] for k in count],
            "concurrent calls gave other results",
        )
    require(_given(asked) == before, "what was given has changed")


class _Turns:
    """Threads that ask the same at the same time, in lines of code that is not chemage's own: none goes on before the
    others have come as far, so that what they share is overwritten whatever else the machine does."""

    def __init__(self, ask: Callable[[Any], bytes], threads: int) -> None:
        self.ask = ask
        self.places = [0] * threads
        self.moved = Condition()

    def come(self, thread: int, place: int, patience: float) -> bool:
        """Say where a thread is, and wait for the others; False where they are not there in time, s."""
        with self.moved:
            self.places[thread] = place
            self.moved.notify_all()
            return self.moved.wait_for(lambda: min(self.places) >= place, patience)

    def answers(self, thread: int, questions: Sequence[Any]) -> list[bytes]:
        """The answers of one thread, which begins each question with the others."""
        return [self._answer(thread, *each) for each in enumerate(questions)]

    def _answer(self, thread: int, number: int, question: Any) -> bytes:
        first, end = number * TURNS, (number + 1) * TURNS
        self.come(thread, first, 10.0)
        # where the others are in long computations again and again, it goes on alone
        lines, late = (place for place in range(first + 1, end)), list[int]()

        def trace(frame: Any, event: str, _: Any) -> Any:
            if frame.f_globals.get("__name__", "").partition(".")[0] in OURS:
                return None
            if event == "line":
                place = next(lines, None)
                if place is not None and not self.come(thread, place, 0.05):
                    late.append(place)
                    if len(late) > 3:
                        lines.close()
            return trace

        before = sys.gettrace()
        sys.settrace(trace)
        try:
            return self.ask(question)
        finally:
            sys.settrace(before)
            self.come(thread, end, 0.0)


def _given(asked: list[Callable[[Any], Any]]) -> bytes:
    """What the questions are about: the arrays in it, of records too."""
    given = [
        [*inspect.getclosurevars(ask).nonlocals.values(), *(ask.__defaults__ or ())]
        for ask in asked
    ]
    return as_bytes(given)


def answers(
    component: Component, inputs: Mapping[str, Any], backwards: bool = False
) -> dict[str, bytes]:
    """The answers to all questions of the role, and those to the first of them with each option at another value, which
    are asked in order, or ``backwards``."""
    questions = list(questions_of(component, inputs))
    asked = [(what, component, ask) for what, ask in questions]
    for name in type(component).model_fields if questions else ():
        for option, variant in islice(Checks(component).other_values(name), 1):
            asked.append(
                (f"{questions[0][0]}, with {option}", variant, questions[0][1])
            )
    return {
        what: answer(variant, ask)
        for what, variant, ask in (asked[::-1] if backwards else asked)
    }


# -- another process --------------------------------------------------------------------------------------------------


@cache
def _worker() -> Any:
    from loky import ProcessPoolExecutor

    return ProcessPoolExecutor(1, timeout=600, env={"PYTHONHASHSEED": "271828"})


# while what it calls when it is collected is there
atexit.register(_worker.cache_clear)


def _asked_elsewhere(path: list[str], content: bytes) -> dict[str, bytes] | None:
    """In the worker process: the answers backwards; None where the component cannot be loaded."""
    sys.path[:] = [*path, *(folder for folder in sys.path if folder not in path)]
    try:
        component, inputs = pickle.loads(content)
    except Exception:
        return None
    return answers(component, inputs, backwards=True)


@contextmanager
def _reading(cls: type) -> Iterator[set[str]]:
    """The attributes of components of ``cls`` that are read in this block, but not by their serialisation."""
    read: set[str] = set()
    inherited: Any = cls.__getattribute__

    def spy(self: Any, name: str) -> Any:
        read.add(name)
        return inherited(self, name)

    with patch.object(cls, "__getattribute__", spy):
        yield read


class AnswerChecks(Checks[Component], of=Component):
    """What follows from the answers to all questions of a role; where the checks of the role say more of what is wrong,
    they come first."""

    last = True

    def _sent(self, inputs: Mapping[str, Any]) -> bytes | None:
        """The component with its class, where that is not installed; None where it cannot be sent."""
        import cloudpickle  # what loky sends with

        module = sys.modules.get(self.cls.__module__)
        installed = (
            registry.current().provider(self.cls) is not None or module is None
        )
        try:
            if not installed:
                cloudpickle.register_pickle_by_value(module)
            return cloudpickle.dumps((self.component, dict(inputs)))
        except Exception:  # `options_go_round` says so
            return None
        finally:
            if not installed:
                cloudpickle.unregister_pickle_by_value(module)

    def answers_do_not_depend_on_what_was_asked_before(self, **inputs: Any) -> None:
        """The answers are the same in this process and in another one that is asked in the opposite order, each
        question after one that differs in one thing: nothing is remembered that does not fit, and no process is
        special."""
        content = self._sent(inputs)
        if content is None:
            return
        elsewhere = _worker().submit(_asked_elsewhere, list(sys.path), content)
        try:
            here, there = (
                answers(self.component, inputs),
                elsewhere.result(LIMIT / 2),
            )
        except BaseException:  # the next component finds a worker that is idle
            _worker().shutdown(wait=False, kill_workers=True)
            _worker.cache_clear()
            raise
        for what, found in (there or {}).items():
            require(
                here[what] == found,
                f"{what}: another process, which was asked the same in the opposite order, has another answer; is "
                "something kept from an earlier call, or does it depend on the process?",
            )

    def options_count(self, **inputs: Any) -> None:
        """Every option is used or changes some answer, and those in ``speed_only``, which change the cost alone, not a
        bit of any."""
        questions = list(questions_of(self.component, inputs))
        if not questions:  # of the role of a plugin
            return
        with _reading(self.cls) as read:
            own = {what: answer(self.component, ask) for what, ask in questions}
        for name in self.cls.model_fields:
            tried = []
            for option, variant in self.other_values(name):
                changed = next(
                    (
                        what
                        for what, ask in questions
                        if answer(variant, ask) != own[what]
                    ),
                    None,
                )
                tried.append(option)
                if name in self.cls.speed_only:
                    require(
                        changed is None,
                        f"{option}: the answers differ ({changed}), but speed_only says that they do not",
                    )
                elif changed is not None:
                    break
            else:
                require(
                    not tried
                    or name in read
                    or name in self.cls.speed_only
                    or self._is_rare(name),
                    f"option {name!r} is not used and changes nothing ({', '.join(tried)} tried); use it, remove it, "
                    "or name it in speed_only if it only changes the cost",
                )

    def _is_rare(self, name: str) -> bool:
        """Whether an option that no question depends on may be for other cases: a choice, such as of what is done where
        nothing converges; one that goes with another option that is off; or any option of a method of ageing, of which
        the questions are about independent sites. Its name is in the code of a method that the class adds to its role.
        """
        cls, value = self.cls, getattr(self.component, name)
        others = [
            getattr(self.component, other)
            for other in cls.model_fields.keys() - {name}
        ]
        off = any(other is None or other is False for other in others)
        if (
            is_number(value)
            and not off
            and not isinstance(self.component, AgeingMethod)
        ):
            return False
        own = {
            name
            for base in cls.__mro__
            if not base.__module__.startswith("chemage.")
            for name in vars(base)
        }
        functions = [
            inspect.unwrap(function)
            for name in own
            if inspect.isfunction(function := getattr(cls, name, None))
        ]
        codes = [function.__code__ for function in functions]
        while codes:
            code = codes.pop()
            if name in code.co_names:
                return True
            codes += [
                constant for constant in code.co_consts if inspect.iscode(constant)
            ]
        return False
