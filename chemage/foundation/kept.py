"""What is computed once for an object, shared by all who ask, and forgotten with it."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Kept(Generic[T]):
    """Results by the identity of an object and a key; they are gone with the object."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: dict[int, dict[Any, T]] = {}

    def get(self, owner: Any, key: Any, make: Callable[[], T]) -> T:
        """The result of ``make`` for ``owner`` and ``key``, which is called once; other threads wait for it."""
        with self._lock:
            known = self._known.get(id(owner))
            if known is None:
                known = self._known[id(owner)] = {}
                weakref.finalize(owner, self._known.pop, id(owner), None)
            if key not in known:
                known[key] = make()
            return known[key]
