"""The base of what a scene consists of beside its components."""

from __future__ import annotations

from chemage.foundation.checks import Frozen


class Section(Frozen):
    """A frozen set of options that is no component."""
