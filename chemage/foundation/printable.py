"""Text from files and users, made harmless for a terminal. Imports nothing, because help and errors use it."""

from __future__ import annotations

#: direction marks that reorder what follows on the screen
_REORDERING = {*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x2028, 0x2029, 0xFEFF}


def printable(text: str) -> str:
    """A text with control characters as escapes, so that a terminal prints and never obeys them.

    Line feeds and tabs stay; terminal escapes, carriage returns and marks that reorder text do not.
    """
    if text.isprintable():
        return text
    return "".join(letter if _harmless(letter) else _escape(letter) for letter in text)


def _harmless(letter: str) -> bool:
    code = ord(letter)
    if letter in "\n\t":
        return True
    return not (code < 32 or 127 <= code < 160 or 0xD800 <= code < 0xE000 or code in _REORDERING)


def _escape(letter: str) -> str:
    return letter.encode("unicode_escape", "surrogatepass").decode("ascii")
