"""Random faults in the sources, one at a time, and whether the quick tests see them.

    python tests/benchmarks/mutants.py RESULTS.jsonl [--count 80] [--seed 1] [--sources DIR] [--dry | --rest]

Draws faults in the code of ``chemage/`` and ``plugins/`` that runs (no docstring, annotation or message): a condition,
a comparison, an operator and a constant in turn, each anywhere with equal probability. Every one is put into a copy of
the checkout DIR, in the folder RESULTS, where the quick tests run that may see it until one fails: those of its own
room first. Results are added to RESULTS.jsonl, and what is there already is not done again.

The first line is a run of all quick tests without a fault, in which every place that is drawn and every function says
which files of tests execute it, in whatever process: the CPU time of each file, which limits that of the faults (one
may make a loop endless), the tests that fail here anyway, which are left out, and RESULTS/executed. A test that never
executes a line cannot fail by it, so that leaving it out loses nothing, but for two things. What one test leaves in a
cache of the process another one may use: the tests of each folder have a process of their own. And some lines are
executed for all tests, or out of sight: for what runs when a module is imported all tests run, those first that execute
a function of it, then those that execute one of a module that imports it; for a module with compiled functions, in
which nothing can be put, those that execute a function of a module that imports it, directly or by other such modules,
or name one of these. No fault has more than ``MOST`` seconds of tests besides those of its room; what is left for one
that survives is in its result, and is run with ``--rest``.

A fault that changes nothing that anybody could see is no fault: it is listed in ``EQUIVALENT`` with the reason. Once
all are done, or with ``--dry`` at once, the table of what was caught and what survived is printed.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import contextlib
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

#: (text before, text after) of a line -> why nobody could see the change
EQUIVALENT: dict[tuple[str, str], str] = {
    (
        "return np.where(np.abs(slope) <= rounding, 0.0, slope)",
        "return np.where((np.abs(slope) < rounding), 0.0, slope)",
    ): "equal only where both are zero",
    (
        "factor = float((one * two).sum() / max(float((two * two).sum()), 1e-300))",
        "factor = float((one * two).sum() / max(float((two * two).sum()), 2e-300))",
    ): "0/0 becomes 0 with either",
    ("@nb.njit(nogil=True)", "@nb.njit(nogil=False)"): "of a function that only kernels call, whose own option counts",
    (
        "kink = edge / max(inside, smallest) if edge > smallest else 0.0",
        "kink = edge / max(inside, smallest) if (edge >= smallest) else 0.0",
    ): "equal to the last bit for no heights",
    (
        "x = np.asarray(sfft.irfft(columns, n=padded[1], axis=1, overwrite_x=True, workers=workers))",
        "x = np.asarray(sfft.irfft(columns, n=padded[1], axis=1, overwrite_x=False, workers=workers))",
    ): "the real transform makes no use of it",
    (
        "self.complete = mass > 1.0 or self.rng.logistic() < odds",
        "self.complete = (mass >= 1.0) or self.rng.logistic() < odds",
    ): "a sum of drawn numbers is never 1 to the last bit",
    ("if barrier <= 0:", "if barrier <= 1:"): "a barrier of 1e-12 eV: a rate is 4e-11 higher",
}

#: room or plugin -> folders of tests that see it, besides the one of its own name
NEAR = {
    "bonds": ("lattices", "friction"),
    "contact": (
        "contacts",
        *(f"physics/test_contact_{part}.py" for part in ("solver", "operators", "invariance", "hertz")),
    ),
    "foundation": ("plugins",),
    "li2018": ("physics",),
    "scaffold": ("plugins",),
    "silica": ("scene", "experiments"),
    "testing": ("plugins/kit",),
}
#: places that are watched from the first run on, so that ``--count`` may grow
WATCHED = 80
#: CPU seconds of tests, without a fault, that a fault has at once besides those of its room
MOST = 60.0
#: CPU seconds beyond three times those of a run without a fault: kernels are compiled anew
SLACK = 120
#: s of waiting beyond six times the CPU seconds; a test that waits for ever uses none
WAITING = 300
#: how functions are marked that numba compiles
COMPILED = re.compile(r"(nb\.)?(njit|jit|hot|inner|kernel)\b")
#: what the places that are drawn call, in the first module that is imported
WATCH = """
import builtins, os
if not hasattr(builtins, "_watch"):
    builtins._tests = [os.environ.get("MUTANTS_TESTS", "")]
    def _watch(place, seen=set()):
        key = place, builtins._tests[0]
        if key not in seen:
            seen.add(key)
            with open({log!r}, "a") as file:
                file.write(place + chr(9) + key[1] + chr(10))
    builtins._watch = _watch
"""

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


def pytest_runtest_logstart(nodeid: str) -> None:
    """In the run without a fault, this file is a plugin of pytest."""
    os.environ["MUTANTS_TESTS"] = nodeid.split("::")[0]
    if hasattr(builtins, "_tests"):
        builtins._tests[0] = os.environ["MUTANTS_TESTS"]  # pyright: ignore


def pytest_runtest_logreport(report: Any) -> None:
    if seconds := os.environ.get("MUTANTS_SECONDS"):
        with Path(seconds).open("a") as file:
            file.write(f"{report.nodeid.split('::')[0]}\t{report.duration:.3f}\n")


def in_function(tree: ast.AST, line: int) -> bool:
    """Whether a line runs when a function is called."""
    functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))
    return any(_first(n.body[0]) <= line <= (n.end_lineno or 0) for n in functions)


def _first(statement: Any) -> int:
    return min(n.lineno for n in (statement, *getattr(statement, "decorator_list", ())))


def watched(source: bytes, path: str, drawn: dict[int, Mutant]) -> bytes:
    """A module in which the places of faults and the functions say that they are executed."""
    changes: list[tuple[int, int, bytes, bytes]] = []
    for number, mutant in drawn.items():
        changes.append((mutant.begin, mutant.end, f'(_watch("{number}"), '.encode(), b")[1]"))
    # a place within another one is executed with it
    changes.sort(key=lambda change: (change[0], -change[1]))
    outer: list[tuple[int, int, bytes, bytes]] = []
    for begin, end, before, after in changes:
        if outer and begin < outer[-1][1]:
            call = before[1 : before.index(b")") + 1] + b", "
            outer[-1] = (
                *outer[-1][:2],
                b"(" + call + outer[-1][2][1:],
                b")[" + b"%d]" % (outer[-1][2].count(b"_watch") + 1),
            )
        else:
            outer.append((begin, end, before, after))
    pieces = [(begin, before) for begin, _, before, _ in outer] + [(end, after) for _, end, _, after in outer]
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[ast.get_docstring(node) is not None :]
            if body:
                line = _first(body[0])
                start = starts[line - 1]
                indent = source[start : start + len(source[start:]) - len(source[start:].lstrip())]
                if line == body[0].lineno and body[0].col_offset != len(indent):
                    pieces.append((start + body[0].col_offset, f'_watch("{path}"); '.encode()))
                else:
                    pieces.append((start, indent + f'_watch("{path}")\n'.encode()))
    for at, text in sorted(pieces, key=lambda piece: piece[0], reverse=True):
        source = source[:at] + text + source[at:]
    return source


def _compiles(mark: ast.AST) -> bool:
    return COMPILED.match(ast.unparse(mark)) is not None


class Place:
    """A copy of a checkout, in which tests run."""

    def __init__(self, sources: Path, folder: Path) -> None:
        self.folder, self.root = folder, folder / "chemage"
        self.sources = sources
        self.fill()
        self.kernels = folder / "kernels"
        self.trees = {
            file.relative_to(self.root).as_posix(): ast.parse(file.read_bytes())
            for top in ("chemage", "plugins")
            for file in sorted((self.root / top).rglob("*.py"))
        }
        self.compiled = {
            name
            for name, tree in self.trees.items()
            if any(isinstance(n, ast.FunctionDef) and any(map(_compiles, n.decorator_list)) for n in ast.walk(tree))
        }
        self.executed: dict[str, set[str]] = {}

    def fill(self) -> None:
        """Copy the checkout."""
        skip = shutil.ignore_patterns(".git", "__pycache__", ".venv", ".*_cache", "*.egg-info")
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.copytree(self.sources, self.root, ignore=skip)
        # the plugins of this checkout, and not those of the one that is installed
        project = tomllib.loads((self.root / "pyproject.toml").read_text())["project"]
        info = self.folder / "site" / f"chemage-{project['version']}.dist-info"
        info.mkdir(parents=True, exist_ok=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: chemage\nVersion: {project['version']}\n")
        groups = {"console_scripts": project["scripts"], **project["entry-points"]}
        lines = [
            [f"[{group}]", *(f"{name} = {place}" for name, place in items.items())] for group, items in groups.items()
        ]
        (info / "entry_points.txt").write_text("\n".join(line for group in lines for line in group) + "\n")

    def test(
        self, what: list[str], without: list[str], seconds: float, kernels: Path | None = None, watched: bool = False
    ) -> dict[str, Any]:
        """Run tests: the names of those that failed, the exit status, and the CPU time."""
        paths = [self.root, self.root / "plugins", self.folder / "site", *[Path(__file__).parent] * watched]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths)), "PYTHONHASHSEED": "0"}
        environment |= {
            "NUMBA_CACHE_DIR": str(kernels or self.kernels),
            "OMP_NUM_THREADS": "1",
            "NUMBA_NUM_THREADS": "2",
        }
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no"]
        if watched:
            environment |= {"MUTANTS_SECONDS": str(self.folder / "seconds")}
            command += ["-p", "mutants"]
        else:
            command += ["-x"]
        command += [f"--{'deselect' if '::' in name else 'ignore'}={name}" for name in without]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()

        def limits() -> None:
            resource.setrlimit(resource.RLIMIT_CPU, (round(seconds), round(seconds) + 10))

        process = subprocess.Popen(
            [*command, *what], cwd=self.root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            text=True, preexec_fn=limits, start_new_session=True,
        )  # fmt: skip
        try:
            printed = process.communicate(timeout=6 * seconds + WAITING)[0]
        except subprocess.TimeoutExpired:
            printed = ""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return {
            "status": process.returncode,
            "failed": re.findall(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE),
            "cpu": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
            "wall": round(time.monotonic() - begin, 1),
            "said": printed.strip().splitlines()[-1:],
        }

    def plain(self, drawn: list[Mutant]) -> dict[str, Any]:
        """The run of all tests without a fault, one folder after the other."""
        log, times = self.folder / "executed", self.folder / "seconds"
        for file in (log, times):
            file.write_text("")
        for name in sorted(set(self.trees) - self.compiled):
            path = self.root / name
            here = {number: mutant for number, mutant in enumerate(drawn) if mutant.path == name}
            text = watched(path.read_bytes(), name, here)
            if name == "chemage/__init__.py":
                line = b"from __future__ import annotations\n"
                text = text.replace(line, line + f"exec({WATCH.format(log=str(log))!r}, {{}})\n".encode(), 1)
            ast.parse(text)
            path.write_bytes(text)
        folders = sorted({file.relative_to(self.root).parts[1] for file in (self.root / "tests").rglob("test_*.py")})
        runs = []
        for name in folders:
            runs.append(self.test([f"tests/{name}"], [], 3600, watched=True))
            print(name, runs[-1], flush=True)
        # what fails because it is watched is no failure
        self.fill()
        failed = [name for run in runs for name in run["failed"]]
        again = [name for name in failed if self.test([name], [], 600)["status"] != 0]
        seconds: dict[str, float] = {}
        for line in times.read_text().splitlines():
            file, duration = line.split("\t")
            seconds[file] = seconds.get(file, 0.0) + float(duration)
        # what a busy machine took longer is the same share of all
        cpu = sum(run["cpu"] for run in runs)
        share = cpu / sum(seconds.values())
        return {
            "status": max(run["status"] for run in runs if run["status"] != 5),
            "watched": len(drawn),
            "failed": again,
            "cpu": round(cpu, 1),
            "seconds": {file: round(share * value, 2) for file, value in seconds.items()},
        }

    def executing(self, place: str) -> set[str]:
        """The files of tests that execute a place, or any function of a module."""
        if not self.executed:
            for line in (self.folder / "executed").read_text().splitlines():
                name, file = line.split("\t")
                self.executed.setdefault(name, set()).add(file)
        return self.executed.get(place, set())

    def importers(self, path: str) -> list[str]:
        """The files that import a module."""
        parts = Path(path.removeprefix("plugins/")).with_suffix("").parts
        own = ".".join(part for part in parts if part != "__init__")
        found = []
        for name, tree in self.trees.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom):
                    names = [str(node.module), *(f"{node.module}.{part.name}" for part in node.names)]
                elif isinstance(node, ast.Import):
                    names = [part.name for part in node.names]
                else:
                    continue
                if own in names and name != path:
                    found.append(name)
                    break
        return found

    def kernels_of(self, path: str) -> tuple[list[str], list[str]]:
        """The modules with compiled functions that depend on one, itself first, and the others that import any."""
        compiled, others = [path], []
        for module in compiled:
            for name in self.importers(module):
                where = compiled if name in self.compiled else others
                if name not in where:
                    where.append(name)
        return compiled, others

    def order(self, number: int, mutant: Mutant, seconds: dict[str, float]) -> tuple[list[str], str]:
        """The files of tests that may see a fault, those of its room first, and why these."""
        compiled, others = self.kernels_of(mutant.path)
        direct = self.executing(str(number))
        own = near(self.root, mutant.path)
        if mutant.path in self.compiled:
            words = re.compile("|".join(rf"\b{Path(name).stem}\b" for name in compiled))
            ranks = [{file for file in seconds if words.search((self.root / file).read_text())}]
            ranks.append({file for name in others for file in self.executing(name)})
            why = "compiled"
        elif in_function(self.trees[mutant.path], mutant.line) and "" not in direct:
            why, ranks = "executed", [direct]
        else:
            why, ranks = "imported", [direct, self.executing(mutant.path)]
            ranks += [{file for name in self.importers(mutant.path) for file in self.executing(name)}, set(seconds)]

        def rank(file: str) -> tuple[bool, int, float]:
            close = any(file == part or file.startswith(part + "/") for part in own)
            return not close, next(at for at, files in enumerate(ranks) if file in files), seconds[file]

        return sorted((file for file in seconds if any(file in files for files in ranks)), key=rank), why

    def judge(
        self, number: int, mutant: Mutant, plain: dict[str, Any], left: list[str] | None = None
    ) -> dict[str, Any]:
        """Whether the tests see a fault: those of its room, then the others (or those left over from before)."""
        path = self.root / mutant.path
        source, times = path.read_bytes(), path.stat()
        seconds = plain["seconds"]
        files, why = self.order(number, mutant, seconds)
        own = near(self.root, mutant.path)
        close = [file for file in files if any(file == part or file.startswith(part + "/") for part in own)]
        further = files[len(close) :]
        if left is not None:
            close, further = [], left
        used, taken = sum(seconds[file] for file in close), []
        while further and (left is not None or used + seconds[further[0]] <= MOST or not taken):
            used += seconds[further[0]]
            taken.append(further.pop(0))
        steps: list[dict[str, Any]] = []
        with tempfile.TemporaryDirectory(dir=self.folder) as fresh:
            kernels = Path(fresh) / "kernels"
            shutil.copytree(self.kernels, kernels)
            for name in self.kernels_of(mutant.path)[0]:
                for file in kernels.glob(f"{Path(name).parent.name}_*/{Path(name).stem}.*"):
                    file.unlink()
            path.write_bytes(mutant.applied(source))
            try:
                for what in (close, taken):
                    without = list(plain["failed"])
                    while what and (not steps or steps[-1]["status"] == 0):
                        limit = 3 * sum(seconds[file] for file in what) + SLACK
                        steps.append(self.test(what, without, limit, kernels))
                        failed = steps[-1]["failed"]
                        if what is close or steps[-1]["status"] == 0 or not failed or "::" not in failed[0]:
                            break
                        # a test of another room that fails has to fail twice
                        if self.test(failed[:1], [], limit, kernels)["status"] != 0:
                            break
                        without.append(failed[0])
                        steps[-1]["status"] = 0
            finally:
                path.write_bytes(source)
                os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        last = steps[-1] if steps else {"status": 0, "failed": [], "said": ["no test executes it"]}
        caught = last["status"] not in (0, 5)
        return {
            "caught": caught,
            "by": last["failed"] or last["said"],
            "in": "room" if close and len(steps) == 1 else "all",
            "why": why,
            "files": len(files),
            "left": [] if caught else further,
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
        said = "equivalent" if reason else "" if done is None else "caught" if done["caught"] else "survived"
        if said:
            numbers[said] += 1
        by = f" ({reason})" if reason else f" ({', '.join(done['by'][:1])})" if done and done["caught"] else ""
        yield f"{number:3} {said or 'not done':10} {mutant.kind:10} {mutant.path}:{mutant.line}{by}"
        yield f"      - {lines[0]}\n      + {lines[1]}"
    yield ", ".join(f"{count} {what}" for what, count in numbers.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sources", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--rest", action="store_true", help="of those that survived, run the tests that are left")
    parser.add_argument("--dry", action="store_true", help="run no tests, print what is drawn and done")
    options = parser.parse_args()
    drawn = draw(options.sources, options.count, options.seed)
    lines = [json.loads(line) for line in options.results.read_text().splitlines()] if options.results.exists() else []
    results = {line["number"]: line for line in lines[1:]}
    if options.dry:
        print("\n".join(table(options.sources, drawn, results)))
        return
    os.nice(max(10 - os.nice(0), 0))
    folder = options.results.absolute().with_suffix("")
    folder.mkdir(exist_ok=True)
    with options.results.open("a") as file:
        place = Place(options.sources, folder)

        def keep(line: dict[str, Any]) -> None:
            file.write(json.dumps(line) + "\n")
            file.flush()

        plain = lines[0] if lines else place.plain(draw(options.sources, max(options.count, WATCHED), options.seed))
        if not lines:
            keep(plain)
        if plain["status"] not in (0, 1):
            sys.exit(f"the tests do not run: {plain}")
        if options.count > plain["watched"]:
            sys.exit(f"--count {options.count}: {plain['watched']} were watched; begin a new file of results")
        for number, mutant in enumerate(drawn):
            left = results[number].get("left") if number in results else None
            if EQUIVALENT.get(mutant.lines((options.sources / mutant.path).read_bytes())):
                results[number] = {"number": number, "caught": False}
            elif number not in results or (options.rest and left):
                results[number] = {"number": number, **mutant._asdict(), **place.judge(number, mutant, plain, left)}
                keep(results[number])
                print(f"{number}: {mutant.path}:{mutant.line} caught: {results[number]['caught']}", flush=True)
        print("\n".join(table(options.sources, drawn, results)))


if __name__ == "__main__":
    main()
