"""Types that signatures name again and again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, TypeAlias

#: values by name, such as what TOML and JSON hold, and options of functions: to be changed, or only to be read
Data: TypeAlias = dict[str, Any]
Fields: TypeAlias = Mapping[str, Any]
#: what :func:`open` takes
AnyPath: TypeAlias = str | os.PathLike[str]
