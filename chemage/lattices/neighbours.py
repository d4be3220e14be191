"""The graph of neighbouring sites of a contact, made once and shared by its replicas."""

from __future__ import annotations

import threading
import weakref

import numpy as np

from chemage.contacts.solution import ContactSolution
from chemage.foundation.records import frozen
from chemage.lattices.role import Interaction

_lock = threading.Lock()
#: by the identity of a contact, and gone with it
_graphs: dict[int, dict[Interaction, np.ndarray]] = {}


def neighbours_of(contact: ContactSolution, interaction: Interaction) -> np.ndarray:
    """Which pixels in contact are neighbours under ``interaction``: (n, k) int32, -1 = none; read-only."""
    # one replica at a time makes it, and the others wait for it
    with _lock:
        known = _graphs.get(id(contact))
        if known is None:
            known = _graphs[id(contact)] = {}
            weakref.finalize(contact, _graphs.pop, id(contact), None)
        if interaction not in known:
            graph = interaction.neighbours(contact.shape, contact.periodic, contact.sites)
            known[interaction] = frozen(graph, np.int32)
        return known[interaction]
