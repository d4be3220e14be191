"""The package of a page of the docs: its files, built from the page's code blocks, installed, and used."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


class Tutorial:
    """A part of a page of ``docs``; each block of a file begins with the file's path in a comment."""

    def __init__(self, page: str, begin: str = "", end: str = "\0") -> None:
        _, _, rest = f"\n{(DOCS / page).read_text(encoding='utf-8')}".partition(f"\n{begin}")
        self.text = rest.partition(f"\n{end}")[0]
        #: (language, code) of every block
        self.blocks = re.findall(r"^```(\w*)\n(.*?)^```", self.text, re.MULTILINE | re.DOTALL)
        self.files = {found[1]: code for _, code in self.blocks if (found := re.match(r"# (\S+\.\w+)\n", code))}

    def install(self, root: Path) -> Path:
        """Write the files into ``root``, importable and with the entry points that pip would record."""
        for path, code in self.files.items():
            file = root / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(code, encoding="utf-8")
        settings = tomllib.loads(self.files["pyproject.toml"])["project"]
        name, version = settings["name"], settings["version"]
        info = root / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        points = "".join(f"{point} = {value}\n" for point, value in settings["entry-points"]["chemage"].items())
        (info / "entry_points.txt").write_text(f"[chemage]\n{points}")
        return root


def run_python(project: Path, *command: str, status: int = 0) -> str:
    """What Python prints where the package of ``project`` is installed, beside the chemage that is under test."""
    path = os.pathsep.join([str(project), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *command],
        cwd=project,
        env={**os.environ, "PYTHONPATH": path, "CHEMAGE_STRICT": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr if status else done.stdout
