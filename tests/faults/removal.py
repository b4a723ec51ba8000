"""Take one protection out of a copy of the source, and run the test that must miss it.

A protection is anchored by the object that holds it, so that mypy sees a rename and an
import sees a move, and by its syntax tree there: layout and comments do not count.
"""

import ast
import inspect
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Final, NamedTuple

import imu_tracker
from support.paths import REPOSITORY

PACKAGE: Final = Path(imu_tracker.__file__).parent
CELL: Final = (
    "tests/faults/test_campaign.py::test_the_daemon_survives_and_tells_the_truth"
)


class AnchorError(ValueError):
    """A protection is not where the table says; the message says what to do."""


class Protection(NamedTuple):
    """One of them.

    Attributes
    ----------
    trap, protection : str
        What goes wrong without it, and what prevents that.
    where : function, method or module
        What holds it.
    line : str
        An expression, a statement or `if` with its condition, which `where` has once;
        of a module the name of a constant.
    without : str
        What stands there when the protection is taken out.
    test : str
        A node id of pytest, or a cell of the campaign in brackets.
    """

    trap: str
    protection: str
    where: Callable[..., object] | ModuleType
    line: str
    without: str
    test: str

    @property
    def node(self) -> str:
        """The test as a node id."""
        return f"{CELL}{self.test}" if self.test.startswith("[") else self.test

    @property
    def file(self) -> Path:
        """The file of the source, relative to the package."""
        file = inspect.getsourcefile(self.where)
        assert file is not None
        return Path(file).relative_to(PACKAGE)

    @property
    def place(self) -> str:
        """Module and function, as a reader looks them up."""
        module = ".".join(self.file.with_suffix("").parts)
        if isinstance(self.where, ModuleType):
            return module
        return f"{module}.{self.where.__qualname__}"

    def removed(self) -> str:
        """Return the text of `file` without the protection.

        Raises
        ------
        AnchorError
            When `where` does not have `line` exactly once.
        """
        text = (PACKAGE / self.file).read_bytes()
        found = list(self._nodes(ast.parse(text)))
        if len(found) != 1:
            raise AnchorError(
                f"{self.place} has {self.line!r} {len(found)} times instead of once."
                " If the protection has changed or moved, correct its entry in"
                " tests/faults/protections.py; if it is gone, bring it back"
            )
        begin, end = _span(found[0], text)
        replacement = self.without.removeprefix("if ").encode()
        changed = (text[:begin] + replacement + text[end:]).decode()
        ast.parse(changed)
        return changed

    def _nodes(self, tree: ast.Module) -> Iterator[ast.AST]:
        """Yield the nodes of `where` that are `line`."""
        if isinstance(self.where, ModuleType):
            for line in tree.body:
                match line:
                    case ast.AnnAssign(
                        target=ast.Name(id=self.line), value=ast.expr() as value
                    ):
                        yield value
            return
        is_condition = self.line.startswith("if ") and "\n" not in self.line
        wanted: ast.AST = ast.parse(f"{self.line}: 0" if is_condition else self.line)
        match wanted:
            case ast.Module(body=[ast.If(test=test)]) if is_condition:
                wanted = test
            case ast.Module(body=[ast.Expr(value=value)]):
                wanted = value
            case ast.Module(body=[statement]):
                wanted = statement
        for node in ast.walk(_named(tree, self.where.__qualname__)):
            candidate = getattr(node, "test", None) if is_condition else node
            if isinstance(candidate, ast.AST) and ast.dump(candidate) == ast.dump(
                wanted
            ):
                yield candidate


def _named(tree: ast.AST, qualname: str) -> ast.AST:
    """Return the definition of a function or method."""
    for name in qualname.split("."):
        tree = next(
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name
        )
    return tree


def _span(node: ast.AST, text: bytes) -> tuple[int, int]:
    """Return where a node begins and ends, in bytes of the text."""
    assert isinstance(node, ast.expr | ast.stmt)
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    lines = text.splitlines(keepends=True)
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    return begin, end


def fails_without(protection: Protection) -> str:
    """Take it out, run its test; return what ails the check, or "" when it fell."""
    with tempfile.TemporaryDirectory(prefix="without-") as directory:
        source = Path(directory) / "src"
        shutil.copytree(PACKAGE, source / PACKAGE.name)
        (source / PACKAGE.name / protection.file).write_text(
            protection.removed(), "utf-8"
        )
        done = subprocess.run(
            [
                *(sys.executable, "-m", "pytest", "-x", "-q"),
                *("-p", "no:cacheprovider", protection.node),
            ],
            cwd=REPOSITORY,
            env={**os.environ, "PYTHONPATH": str(source)},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode == 1 and "failed" in done.stdout:
        return ""
    return (
        f"its test ends with {done.returncode}:"
        f" {done.stdout[-300:]}{done.stderr[-300:]}"
    )
