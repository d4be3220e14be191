"""Random faults in the sources, one at a time, and whether the quick tests see them.

    python tests/benchmarks/mutants.py RESULTS.jsonl [--count 80] [--seed 1] [--sources DIR] [--dry]

Draws faults in the code of ``chemage/`` and ``plugins/`` that runs (no docstring, annotation or message): a condition,
a comparison, an operator and a constant in turn, each anywhere with equal probability. Every one is put into a copy of
the checkout DIR, where the tests of its own room run first and all quick tests only if those pass. Results are added to
RESULTS.jsonl, and what is there already is not done again. Its first line is a run without a fault: the CPU time that
limits the others (a fault may make a loop endless), and tests that fail here anyway, which are left out.

A fault that changes nothing that anybody could see is no fault: it is listed in ``EQUIVALENT`` with the reason. Once
all are done, or with ``--dry`` at once, the table of what was caught and what survived is printed.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

#: (text before, text after) of a line -> why nobody could see the change
EQUIVALENT: dict[tuple[str, str], str] = {}

#: room or plugin -> folders of tests that see it, besides the one of its own name
NEAR = {
    "bonds": ("lattices", "friction"),
    "contact": ("contacts", "physics/test_contact.py"),
    "foundation": ("plugins",),
    "li2018": ("physics",),
    "scaffold": ("plugins",),
    "silica": ("scene", "experiments"),
    "testing": ("plugins/kit",),
}
#: CPU seconds beyond three times those of a run without a fault
SLACK = 180
#: s; a test that waits for ever uses no CPU time
LONGEST = 3 * 3600

COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
#: code in which nothing is changed
SILENT = (ast.JoinedStr, ast.Raise, ast.Import, ast.ImportFrom)


class Mutant(NamedTuple):
    """One fault: the part of a file from ``begin`` to ``end`` (bytes) becomes ``text``."""

    kind: str
    path: str
    line: int
    begin: int
    end: int
    text: str

    def applied(self, source: bytes) -> bytes:
        return source[: self.begin] + self.text.encode() + source[self.end :]

    def lines(self, source: bytes) -> tuple[str, str]:
        """The line before and after."""
        start = source.rfind(b"\n", 0, self.begin) + 1
        stop = source.find(b"\n", self.end)
        after = source[start : self.begin] + self.text.encode() + source[self.end : stop]
        return " ".join(source[start:stop].decode().split()), " ".join(after.decode().split())


def running(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes of code that runs: no annotations, messages, stack levels, nor what only type checkers or ``python
    FILE`` read."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "type_comment"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if not isinstance(node, ast.AST) or isinstance(
                node, ast.JoinedStr | ast.Raise | ast.Import | ast.ImportFrom
            ):
                continue
            if isinstance(node, ast.If) and re.search(r"TYPE_CHECKING|__name__", ast.unparse(node.test)):
                continue
            if isinstance(node, ast.keyword) and node.arg == "stacklevel":
                continue
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("warn"):
                continue
            yield node
            yield from running(node)


def changed(node: Any) -> Iterator[tuple[str, ast.AST, ast.AST]]:
    """(kind, node, what takes its place) of every fault of one node."""
    if isinstance(node, ast.Compare):
        for at, operator in enumerate(node.ops):
            others = [*node.ops[:at], COMPARISONS[type(operator)](), *node.ops[at + 1 :]]
            yield "comparison", node, ast.Compare(node.left, others, node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        # types joined by |, or text put together
        if not (isinstance(node.op, ast.BitOr) or isinstance(node.left, ast.Constant | ast.JoinedStr)) or _number(node):
            yield "operator", node, ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        value = node.value
        other = not value if isinstance(value, bool) else value + 1 if isinstance(value, int) else 2 * value or 1.0
        yield "constant", node, ast.Constant(other)
    elif isinstance(node, ast.BoolOp):
        yield "condition", node, ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
    if isinstance(node, ast.If | ast.While | ast.IfExp):
        yield "condition", node.test, ast.UnaryOp(ast.Not(), node.test)


def _number(node: ast.BinOp) -> bool:
    return isinstance(node.left, ast.Constant) and isinstance(node.left.value, int | float)


def mutants(root: Path) -> dict[str, list[Mutant]]:
    """Every fault of every kind, in the order of the files."""
    found: dict[str, list[Mutant]] = {}
    for path in sorted(file for folder in ("chemage", "plugins") for file in (root / folder).rglob("*.py")):
        source = path.read_bytes()
        starts = [0]
        for line in source.splitlines(keepends=True):
            starts.append(starts[-1] + len(line))
        for node in running(ast.parse(source)):
            for kind, old, new in changed(node):
                place: Any = old
                begin = starts[place.lineno - 1] + place.col_offset
                end = starts[place.end_lineno - 1] + place.end_col_offset
                text = f"({ast.unparse(ast.fix_missing_locations(new))})"
                if isinstance(old, ast.Constant):
                    text = text[1:-1]
                name = path.relative_to(root).as_posix()
                found.setdefault(kind, []).append(Mutant(kind, name, place.lineno, begin, end, text))
    return found


def draw(root: Path, count: int, seed: int) -> list[Mutant]:
    """``count`` faults, as many of one kind as of another."""
    kinds = mutants(root)
    generator = random.Random(seed)
    return [generator.choice(kinds[sorted(kinds)[number % len(kinds)]]) for number in range(count)]


def near(root: Path, path: str) -> list[str]:
    """The tests of the room of a file, as far as they exist."""
    rooms = [part.removeprefix("chemage_").removesuffix(".py") for part in Path(path).parts[1:]]
    names = [name for room in rooms for name in (room, *NEAR.get(room, ()))]
    return [f"tests/{name}" for name in dict.fromkeys(names) if (root / "tests" / name).exists()]


class Place:
    """A copy of a checkout, in which tests run."""

    def __init__(self, sources: Path, folder: Path) -> None:
        self.root = folder / "chemage"
        skip = shutil.ignore_patterns(".git", "__pycache__", ".venv", ".*_cache", "*.egg-info")
        shutil.copytree(sources, self.root, ignore=skip)
        self.kernels = folder / "kernels"

    def test(self, what: list[str], without: list[str], seconds: float, fresh: bool = False) -> dict[str, Any]:
        """Run tests: the names of those that failed, the exit status, and the CPU time."""
        kernels = tempfile.mkdtemp(dir=self.root.parent) if fresh else str(self.kernels)
        paths = os.pathsep.join([str(self.root), str(self.root / "plugins")])
        environment = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": kernels, "PYTHONHASHSEED": "0"}
        options = [f"--{'deselect' if '::' in name else 'ignore'}={name}" for name in without]
        options += ["-x"] * (seconds < LONGEST)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no", *options, *what]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()

        def limits() -> None:
            resource.setrlimit(resource.RLIMIT_CPU, (round(seconds), round(seconds) + 10))

        try:
            done = subprocess.run(
                command, cwd=self.root, env=environment, capture_output=True, text=True, timeout=LONGEST,
                preexec_fn=limits,
            )  # fmt: skip
            status, printed = done.returncode, done.stdout
        except subprocess.TimeoutExpired:
            status, printed = -1, ""
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if fresh:
            shutil.rmtree(kernels, ignore_errors=True)
        return {
            "status": status,
            "failed": re.findall(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE),
            "cpu": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
            "wall": round(time.monotonic() - begin, 1),
            "said": printed.strip().splitlines()[-1:],
        }

    def judge(self, mutant: Mutant, plain: dict[str, Any]) -> dict[str, Any]:
        """Whether the tests see a fault: those of its room, then all."""
        path = self.root / mutant.path
        source, times = path.read_bytes(), path.stat()
        path.write_bytes(mutant.applied(source))
        compiled = b"numba" in source
        own = near(self.root, mutant.path)
        steps: list[dict[str, Any]] = []
        try:
            for what in [own] * bool(own) + [["tests"]]:
                steps.append(self.test(what, plain["failed"], 3 * plain["cpu"] + SLACK, compiled))
                if steps[-1]["status"] != 0:
                    break
        finally:
            path.write_bytes(source)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        last = steps[-1]
        return {
            "caught": last["status"] != 0,
            "by": last["failed"] or last["said"],
            "in": "room" if own and len(steps) == 1 else "all",
            "compiled": compiled,
            "cpu": round(sum(step["cpu"] for step in steps), 1),
            "wall": round(sum(step["wall"] for step in steps), 1),
        }


def table(root: Path, drawn: list[Mutant], results: dict[int, dict[str, Any]]) -> Iterator[str]:
    """What was caught, what survived and what is equivalent, each with its place and change; and the numbers."""
    numbers = {"caught": 0, "survived": 0, "equivalent": 0}
    for number, mutant in enumerate(drawn):
        lines = mutant.lines((root / mutant.path).read_bytes())
        reason = EQUIVALENT.get(lines)
        done = results.get(number)
        said = "" if done is None else "equivalent" if reason else "caught" if done["caught"] else "survived"
        if said:
            numbers[said] += 1
        by = f" ({', '.join(done['by'][:1])})" if done and done["caught"] else f" ({reason})" if reason else ""
        yield f"{number:3} {said or 'not done':10} {mutant.kind:10} {mutant.path}:{mutant.line}{by}"
        yield f"      - {lines[0]}\n      + {lines[1]}"
    yield ", ".join(f"{count} {what}" for what, count in numbers.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sources", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--dry", action="store_true", help="run no tests, print what is drawn and done")
    options = parser.parse_args()
    drawn = draw(options.sources, options.count, options.seed)
    lines = [json.loads(line) for line in options.results.read_text().splitlines()] if options.results.exists() else []
    results = {line["number"]: line for line in lines[1:]}
    if options.dry:
        print("\n".join(table(options.sources, drawn, results)))
        return
    os.nice(max(10 - os.nice(0), 0))
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder, options.results.open("a") as file:
        place = Place(options.sources, Path(folder))

        def keep(line: dict[str, Any]) -> None:
            file.write(json.dumps(line) + "\n")
            file.flush()

        plain = lines[0] if lines else place.test(["tests"], [], LONGEST)
        if not lines:
            keep(plain)
        if plain["status"] not in (0, 1):
            sys.exit(f"the tests do not run: {plain}")
        for number, mutant in enumerate(drawn):
            if number not in results:
                results[number] = {"number": number, **mutant._asdict(), **place.judge(mutant, plain)}
                keep(results[number])
                print(f"{number}: {mutant.path}:{mutant.line} caught: {results[number]['caught']}", flush=True)
        print("\n".join(table(options.sources, drawn, results)))


if __name__ == "__main__":
    main()
