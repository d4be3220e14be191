"""Content hashes of plain JSON values, the same in every process."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def content_hash(content: Any) -> str:
    """128 bits as 32 hexadecimal digits; the order of the entries of a dict does not count."""
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), digest_size=16).hexdigest()
