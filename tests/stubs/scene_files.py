"""A scene of a test as ``chemage check`` sees it."""

from __future__ import annotations

import json
from typing import Any

import tomli_w


def checked(command, folder, scene: dict[str, Any]) -> dict[str, Any]:
    """What ``chemage check --json`` says of a scene; an error of it raises ValueError with what it prints."""
    file = folder / "checked.toml"
    file.write_text(tomli_w.dumps(scene))
    done = command("check", file, "--json")
    if done.status:
        raise ValueError(done.err)
    return json.loads(done.out)
