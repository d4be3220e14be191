"""Options of a plugin, which a scene sets in ``[plugins.NAME]``."""

from __future__ import annotations

import json
from typing import Any, Self

from chemage.foundation.components import Component
from chemage.foundation.units import unit_of
from chemage.plugins import in_use


class PluginOptions(Component):
    """Base of the options of a plugin: a frozen class whose fields are the options, each with a default.

    The module of the plugin names its class, ``CHEMAGE_OPTIONS = "module:Options"``. A scene sets the options in
    ``[plugins.NAME]``, Python with :func:`chemage.plugin_options`; hooks read them with :meth:`current`.
    """

    @classmethod
    def current(cls) -> Self:
        """The options in use in this thread: of the scene that runs or of the block, else the defaults.

        A thread that a plugin starts itself sees the defaults, unless it runs in a copy of the context of its parent
        (``contextvars.copy_context().run``).
        """
        for given in in_use.options().values():
            if type(given) is cls:
                return given
        return cls()

    def changed(self) -> dict[str, Any]:
        """The options that decide the answer and differ from their defaults, as plain JSON values."""
        defaults = type(self)().identity()
        return {name: value for name, value in self.identity().items() if value != defaults[name]}

    def text(self) -> str:
        """The options that decide the answer in one line: ``peak = 2.0 GPa, smooth = true``."""
        fields = type(self).model_fields
        shown = {name: json.dumps(value, sort_keys=True) for name, value in self.identity().items()}
        return ", ".join(f"{name} = {value} {unit_of(fields[name])}".rstrip() for name, value in shown.items())
