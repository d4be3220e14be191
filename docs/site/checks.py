"""Write ``docs/checks.md``, the list of the checks of ``chemage.testing``: ``python docs/site/checks.py``."""

from __future__ import annotations

from pathlib import Path

from chemage.plugin import registry
from chemage.testing.checks import CHECKS, Check

PAGE = Path(__file__).parents[1] / "checks.md"
HEAD = """# What is checked

These are the checks of `chemage.testing`, by role, in the order in which they run. [Writing a
plugin](plugins.md#4-test-it) shows how to use them. Statistical checks use fixed seeds, and reject a correct component
with a probability below one in a million for all of its checks together. Every check is itself tested with components
that are wrong in just this way. This page is made from the docstrings of the checks by `docs/site/checks.py`.
"""


def text() -> str:
    """The page."""
    parts = [HEAD]
    for role in ("", *registry.current().roles):
        parts.append(
            f"\n## {'Every component' if not role else f'Role `{role}`'}\n\n| check | requirement |\n| --- | --- |\n"
        )
        for function in CHECKS[role]:
            check = Check(function.__name__.lstrip("_"), function, {})
            needs = getattr(function, "needs", ())
            given = f" Needs {' and '.join(f'`{name}=`' for name in needs)}." if needs else ""
            requirement = check.requirement.replace("``", "`").replace("|", "\\|")
            parts.append(f"| `{check.name}` | {requirement}{given} |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
