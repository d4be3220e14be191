"""The role that turns bonds into friction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from chemage.foundation.components import Component
from chemage.friction.bonded import Bonded


class Rupture(Component, ABC):
    """Role ``rupture``: the force that breaks the bonds of a contact when it starts to slide."""

    role = "rupture"
    error_of: ClassVar[str] = "the force"
    #: asks for the state of every site at every hold time, :attr:`chemage.plugin.Bonded.states`; the engine must be
    #: able to resume from a history (``restart``)
    states: ClassVar[bool] = False

    @abstractmethod
    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN that breaks all bonds there are after each hold time, (m,), finite and not negative.

        It is the friction drop ΔF, so that a front factor, if there is one, is part of it.
        """
