"""An option whose value is itself a component: ``inner: Choice[ContactSolver]``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BeforeValidator, SerializeAsAny

from chemage.foundation.errors import ChemageError
from chemage.foundation.names import FACTORIES
from chemage.plugins.registry import current

_T = TypeVar("_T")

if TYPE_CHECKING:
    Choice = Annotated[_T, "a component of this role"]
else:

    class Choice:
        """The type of a field that holds a component of a role, such as ``Choice[ContactSolver]``.

        The value may be a component, its kind, or a table with its ``kind`` and options, as in a scene. It is stored
        with all its options; its plugin is named in results; a wrong option is reported by its path.
        """

        def __class_getitem__(cls, role: type) -> Any:
            if not getattr(role, "role", ""):
                raise TypeError(f"Choice[{role!r}]: give the class of a role, such as chemage.plugin.ContactSolver")
            return Annotated[SerializeAsAny[role], BeforeValidator(partial(_chosen, role))]


def _chosen(role: Any, value: Any) -> Any:
    try:
        if isinstance(value, str):
            return current().make(role.role, value, {})
        if isinstance(value, Mapping):
            return current().fromdict(role.role, value)
    except ChemageError as error:
        raise ValueError(str(error)) from None
    if not isinstance(value, role):
        made = f'chemage.{FACTORIES.get(role.role, role.role)}("...")' if role.role != "reader" else "a reader"
        raise ValueError(f"expected a component made with {made}, its kind, or a table with kind and options")
    return value
