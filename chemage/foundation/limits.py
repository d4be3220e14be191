"""What users ask for and chemage does not model: the answer to options, sections and kinds of that name, in one table.

The same in whole sentences is docs/limits.md. A plugin that brings such an option is not concerned: it is known then.
"""

from __future__ import annotations

import re
from collections.abc import Callable

PAGE = "docs/limits.md"
#: how words begin that ask for something -> what is said
ABSENT = {
    (
        "humid",
        "water",
        "vapo",
        "moist",
        "capillar",
        "menisc",
        "lubric",
    ): "of water there is chemistry.humidity, for its transitions; no liquid",
    (
        "velocit",
        "sliding",
        "slid",
        "rate_state",
        "direct_effect",
        "dieterich",
        "slip",
        "stick",
    ): "sliding is a pull, or the [[step]]s of a scene",
    ("heating", "cooling", "ramp", "anneal", "temperature_pro"): (
        "the temperature is constant during a hold; [[step]] changes it, and a sweep over hold.temperature compares several"
    ),
    (
        "wear",
        "abrasi",
        "debris",
        "erosion",
    ): "wear is not modelled: surfaces keep their shape",
    ("plastic", "yield", "harden"): (
        "of plastic flow there is the hardness of a contact, its largest pressure"
    ),
    ("visco", "relaxation", "loss_modul", "storage_modul"): (
        "viscoelasticity is not modelled: contact does not change with time"
    ),
    ("inertia", "mass", "damping", "vibrat"): "inertia is not modelled",
}


def brought(asks: Callable[[str], bool]) -> str:
    """What a plugin brings by a name that ``asks`` for it, in words; "" where there is none. The registry sets it."""
    return ""


def not_modelled(word: str) -> str:
    """What to say of a word that asks for something that chemage does not model, or ""; where a plugin does, that."""
    for starts, answer in ABSENT.items():

        def asks(word: str, starts: tuple[str, ...] = starts) -> bool:
            asked = re.sub(r"[^a-z]+", "_", word.lower().rpartition(".")[2])
            return any(
                asked.startswith(start) or f"_{start}" in asked for start in starts
            )

        if asks(word):
            return brought(asks) or f"{answer}; see {PAGE}"
    return ""
