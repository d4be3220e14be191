"""Make the notebooks in ``docs/notebooks`` from their sources, and execute them: ``python docs/site/notebooks.py``.

Each source is a Python file in the percent format: a line ``# %%`` begins a cell of code, ``# %% [markdown]`` one of
text. ``generate.py`` shows the notebooks as pages of the site. Needs nbclient and ipykernel.
"""

from __future__ import annotations

import html
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "notebooks"
#: output that is kept, the first that a cell has
SHOWN = ("text/html", "image/png", "text/plain")


def cells(source: str) -> Iterator[tuple[str, str]]:
    """(markdown or code, text) of each cell of a source."""
    for part in re.split(r"^# %%", source, flags=re.MULTILINE)[1:]:
        head, _, body = part.partition("\n")
        if "[markdown]" in head:
            yield "markdown", "\n".join(line.removeprefix("#").removeprefix(" ") for line in body.strip().split("\n"))
        else:
            yield "code", body.strip()


def executed(source: str) -> dict[str, Any]:
    """The notebook of a source, with its outputs."""
    import nbformat
    from nbclient import NotebookClient

    new = nbformat.v4
    made = [
        new.new_markdown_cell(text) if kind == "markdown" else new.new_code_cell(text) for kind, text in cells(source)
    ]
    for number, cell in enumerate(made):
        cell["id"] = f"cell-{number}"
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = new.new_notebook(cells=made, metadata=metadata)
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    notebook.metadata = metadata
    for cell in notebook.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = [_kept(output) for output in cell.outputs if output.get("name") != "stderr"]
    return json.loads(nbformat.writes(notebook))


def _kept(output: Any) -> Any:
    if "data" in output:
        output["metadata"] = {}
        output["data"] = {kind: text for kind, text in output["data"].items() if kind in SHOWN}
    return output


def outputs(notebook: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """(type, content) of each output of a notebook, in order."""
    for cell in notebook["cells"]:
        yield from _outputs(cell)


def _outputs(cell: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for output in cell.get("outputs", ()):
        if "text" in output:
            yield "text/plain", "".join(output["text"])
        elif kind := next((kind for kind in SHOWN if kind in output.get("data", {})), None):
            yield kind, "".join(output["data"][kind])


def markdown(path: Path) -> str:
    """A notebook as a page of the site."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for kind, content in _outputs(cell):
            if kind == "image/png":
                source = "".join(content.split())
                parts.append(
                    f'<img class="output" alt="Output of the cell above" src="data:image/png;base64,{source}">'
                )
            elif kind == "text/html":
                parts.append(f'<div class="output">{" ".join(content.split())}</div>')
            else:
                parts.append(f'<pre class="output">{html.escape(content.rstrip())}</pre>')
    parts.append(f"[Download this notebook]({path.name})")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    wanted = sys.argv[1:] or sorted(source.stem for source in FOLDER.glob("*.py"))
    for name in wanted:
        notebook = executed((FOLDER / f"{name}.py").read_text(encoding="utf-8"))
        (FOLDER / f"{name}.ipynb").write_text(
            json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )
        print(f"{name}: {(FOLDER / f'{name}.ipynb').stat().st_size / 1024:.0f} kB")
