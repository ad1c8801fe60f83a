"""How large the house is, what in it nothing reaches, and how long its doors take to open.

Reaching is judged from the source alone: from the commands, the names of ``import exposight`` and
the examples, every name that a reached definition mentions is reached, and a method is reached when
its class is and some reached code mentions its name as an attribute.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src"
PACKAGE = SOURCE / "exposight"
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)

LIMITS: dict[str, tuple[str, float]] = {
    "source_lines": ("≤", 32_500),
    "source_files": ("≤", 160),
    "import_share": ("≤", 0.06),
    "public_names": ("≤", 30),
    "import_s": ("≤", 0.1),
    "unreached_public_functions": ("=", 0),
    "duplicate_file_names": ("=", 0),
    "golden_equal": ("=", True),
    "quick_s": ("≤", 90),
    "install_mb_demo": ("≤", 800),
    "longest_module": ("≤", 420),
}


@dataclass
class Module:
    """A parsed module.

    Parameters
    ----------
    name : str
        Dotted.
    tree : ast.Module
        Its syntax tree.
    imports : dict of str to (str, str or None)
        What a local name stands for: a module, or a module and a name in it.
    """

    name: str
    tree: ast.Module
    imports: dict[str, tuple[str, str | None]] = field(default_factory=dict)


@dataclass
class Definition:
    """A function, class, method or constant, and what it mentions."""

    names: set[tuple[str, str]] = field(default_factory=set)
    attributes: set[str] = field(default_factory=set)
    is_function: bool = False
    owner: tuple[str, str] | None = None


def read_modules(folder: Path, prefix: str) -> dict[str, Module]:
    """Parse every module of a folder and note what its imports bring."""
    modules = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        is_package = parts[-1] == "__init__"
        name = ".".join(filter(None, (prefix, *(parts[:-1] if is_package else parts))))
        module = Module(name=name, tree=ast.parse(path.read_text(encoding="utf-8")))
        for node in ast.walk(module.tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    module.imports[alias.asname or alias.name] = (node.module, alias.name)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    module.imports[alias.asname or alias.name.split(".")[0]] = (alias.name, None)
        modules[name] = module
    return modules


class Graph:
    """Which definition mentions which."""

    def __init__(self, modules: dict[str, Module]) -> None:
        self.modules = modules
        self.definitions: dict[tuple[str, str], Definition] = {}
        self.methods: dict[tuple[str, str], list[tuple[str, str]]] = defaultdict(list)
        for module in modules.values():
            for node in module.tree.body:
                self._define(module, node)

    def _define(self, module: Module, node: ast.stmt) -> None:
        if isinstance(node, ast.If | ast.Try | ast.With):
            for child in ast.iter_child_nodes(node):
                if isinstance(child, ast.stmt):
                    self._define(module, child)
        elif isinstance(node, FUNCTION):
            self._add(module, node.name, node, is_function=True)
        elif isinstance(node, ast.ClassDef):
            key = (module.name, node.name)
            self._add(module, node.name, *node.bases, *node.decorator_list, *node.keywords)
            for child in node.body:
                if not isinstance(child, FUNCTION):
                    self._mention(module, self.definitions[key], child)
                    continue
                name = f"{node.name}.{child.name}"
                if (module.name, name) in self.definitions:  # a setter or overload
                    self._mention(module, self.definitions[module.name, name], child)
                    continue
                self._add(module, name, child, is_function=True, owner=key)
                self.methods[key].append((module.name, name))
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for part in (part for target in targets for part in ast.walk(target)):
                if isinstance(part, ast.Name):
                    self._add(module, part.id, node)
        elif isinstance(node, ast.Expr):
            self._add(module, f"<line {node.lineno}>", node)

    def _add(
        self,
        module: Module,
        name: str,
        *nodes: ast.AST,
        is_function: bool = False,
        owner: tuple[str, str] | None = None,
    ) -> None:
        definition = Definition(is_function=is_function, owner=owner)
        self.definitions[module.name, name] = definition
        for node in nodes:
            self._mention(module, definition, node)

    def _mention(self, module: Module, definition: Definition, node: ast.AST) -> None:
        for child in ast.walk(node):
            if isinstance(child, ast.Name):
                definition.names |= self.resolve(module, child.id)
            elif isinstance(child, ast.Attribute):
                definition.attributes.add(child.attr)
                base = child.value
                if isinstance(base, ast.Name) and base.id in module.imports:
                    target, name = module.imports[base.id]
                    inner = self.modules.get(target if name is None else f"{target}.{name}")
                    if inner is not None:
                        definition.names |= self.resolve(inner, child.attr)
            elif isinstance(child, ast.Constant) and isinstance(child.value, str):
                if child.value.isidentifier():  # getattr, and annotations in quotes
                    definition.attributes.add(child.value)
                    definition.names |= self.resolve(module, child.value)
                elif re.fullmatch(r"exposight[\w.]*:\w+", child.value):
                    target, _, name = child.value.partition(":")
                    definition.names.add((target, name))

    def resolve(self, module: Module, name: str) -> set[tuple[str, str]]:
        """Return the definitions that a name may stand for in a module."""
        for _ in range(10):
            if name not in module.imports:
                return {(module.name, name)}
            target, imported = module.imports[name]
            if imported is None or target not in self.modules:
                return set()
            module, name = self.modules[target], imported
        return set()

    def reach(self, roots: set[tuple[str, str]], attributes: set[str]) -> set[tuple[str, str]]:
        """Return every definition that is reached from some."""
        reached: set[tuple[str, str]] = set()
        waiting, attributes = set(roots), set(attributes)
        while waiting:
            for key in waiting & self.definitions.keys():
                reached.add(key)
                attributes |= self.definitions[key].attributes
            modules = {module for module, _ in reached}
            waiting = {
                *(name for key in reached for name in self.definitions[key].names),
                *(
                    method
                    for key in reached
                    for method in self.methods[key]
                    if (short := method[1].split(".")[1]) in attributes or short.startswith("__")
                ),
                *(key for key in self.definitions if key[1][0] == "<" and key[0] in modules),
            }
            waiting = (waiting & self.definitions.keys()) - reached
        return reached


def unreached_functions() -> list[str]:
    """Return the public functions and classes that nothing of the program reaches."""
    modules = read_modules(PACKAGE, "exposight")
    modules |= read_modules(ROOT / "examples", "examples")
    graph = Graph(modules)
    surface = {name for key in public_names() for name in graph.resolve(modules["exposight"], key)}
    roots = surface | {
        key
        for key in graph.definitions
        if key[0].startswith(("examples", "exposight.cli")) or key[0] == "exposight.__main__"
    }
    # A user of the public surface calls any method of its classes.
    roots |= {method for key in surface for method in graph.methods[key]}
    templates = "".join(path.read_text("utf-8") for path in PACKAGE.rglob("templates/*.html"))
    reached = graph.reach(roots, set(re.findall(r"\.(\w+)", templates)))
    return sorted(
        f"{module}.{name}"
        for (module, name), definition in graph.definitions.items()
        if (module, name) not in reached
        and not any(part.startswith("_") for part in name.split("."))
        and (definition.is_function or (module, name) in graph.methods)
        and not _is_contract(modules[module], name)
    )


def _is_contract(module: Module, name: str) -> bool:
    """Tell whether a method belongs to a Protocol or an abstract class: others implement it."""
    owner = name.split(".", maxsplit=1)[0]
    for node in module.tree.body:
        if isinstance(node, ast.ClassDef) and node.name == owner:
            return any("Protocol" in ast.unparse(base) for base in node.bases)
    return False


def public_names() -> list[str]:
    """Return the names of ``import exposight``."""
    code = "import exposight, json; print(json.dumps(sorted(getattr(exposight, '__all__', []))))"
    names: list[str] = json.loads(_python("-c", code))
    return names


def _python(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout


def size() -> dict[str, float]:
    """Count lines, files, imports and the longest module."""
    lines = imports = 0
    longest = ("", 0)
    names: Counter[str] = Counter()
    paths = sorted(PACKAGE.rglob("*.py"))
    for path in paths:
        text = path.read_text(encoding="utf-8")
        count = len(text.splitlines())
        lines += count
        longest = max(longest, (str(path.relative_to(SOURCE)), count), key=lambda pair: pair[1])
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) != "__all__":
                continue
            if isinstance(node, ast.Import | ast.ImportFrom | ast.Assign):
                imports += (node.end_lineno or node.lineno) - node.lineno + 1
        if path.name != "__init__.py" and path.parent.name != "cli":
            names[path.name] += 1
    print(f"longest module: {longest[0]}")
    twice = sorted(name for name, count in names.items() if count > 1)
    if twice:
        print("file names in two rooms:", ", ".join(twice))
    return {
        "source_lines": lines,
        "source_files": len(paths),
        "import_share": round(imports / lines, 4),
        "duplicate_file_names": len(twice),
        "longest_module": longest[1],
    }


def import_seconds() -> float:
    """Return the least time of five that ``import exposight`` takes, in s."""
    code = "import time; t = time.perf_counter(); import exposight; print(time.perf_counter() - t)"
    return round(min(float(_python("-c", code)) for _ in range(5)), 4)


def golden_equal() -> bool:
    """Tell whether the small study gives the numbers on record."""
    done = subprocess.run([sys.executable, "-m", "pytest", "tests/golden"], cwd=ROOT, check=False)
    return done.returncode == 0


def quick_seconds() -> float:
    """Return what ``make quick`` takes once everything is compiled, in s."""
    command = ["make", "--no-print-directory", "quick"]
    for _ in range(2):
        start = time.perf_counter()
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return round(time.perf_counter() - start, 1)


def demo_megabytes() -> int:
    """Install what ``make demo`` installs in a folder of its own and return its size in MB."""
    with tempfile.TemporaryDirectory() as folder:
        venv = Path(folder) / "venv"
        subprocess.run(
            ["make", "--no-print-directory", f"VENV={venv}", f"{venv}/.ready"],
            cwd=ROOT,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        done = subprocess.run(["du", "-sm", venv], capture_output=True, text=True, check=True)
    return int(done.stdout.split()[0])


def main() -> None:
    """Measure all of it, print a table and, as the last line, one JSON object."""
    figures: dict[str, float] = size()
    figures["public_names"] = len(public_names())
    figures["import_s"] = import_seconds()
    unreached = unreached_functions()
    for name in unreached:
        print(f"unreached: {name}")
    figures["unreached_public_functions"] = len(unreached)
    if "--source" not in sys.argv:
        figures["install_mb_demo"] = demo_megabytes()
        figures["golden_equal"] = golden_equal()
        figures["quick_s"] = quick_seconds()
    table = Table("figure", "limit", "here", title="the house")
    for name, (sign, limit) in LIMITS.items():
        if name in figures:
            value = figures[name]
            kept = value == limit if sign == "=" else value <= limit
            table.add_row(name, f"{sign} {limit}", f"{value}" if kept else f"[red]{value}[/red]")
    Console().print(table)
    print(json.dumps({name: figures[name] for name in LIMITS if name in figures}))


if __name__ == "__main__":
    main()
