"""The rule of the house: who may import what, read from the sources."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import imu_tracker

ROOT = Path(imu_tracker.__file__).parent
PACKAGE = "imu_tracker"

PURE = (
    *("samples", "errors", "estimation", "calibration", "simulation", "integrity"),
    "pipeline",
)
PURE_NMEA = ("sensors.nmea", "sensors.nmea_")
"""The rooms without clock, file, thread, logger or bus."""

FORBIDDEN = {
    *("time", "os", "io", "socket", "threading", "subprocess", "logging", "random"),
    *("sys", "pathlib", "shutil", "tempfile", "signal", "queue", "asyncio", "select"),
}
ALLOWED_LIBRARIES = {"numpy", "filterpy", "pynmea2"}
CALIBRATION_LIBRARIES = ALLOWED_LIBRARIES | {"allantools"}

TOP = ("cli", "commands", "__main__")
"""Only these import a command; nobody imports `cli` but the way in."""


def name_of(path: Path) -> str:
    """Dotted name inside the package; of a room's __init__ the room's."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def is_in(name: str, rooms: tuple[str, ...]) -> bool:
    return any(name == room or name.startswith(f"{room}.") for room in rooms)


def is_pure(name: str) -> bool:
    return is_in(name, PURE) or name == PURE_NMEA[0] or name.startswith(PURE_NMEA[1])


def imports_of(path: Path) -> Iterator[str]:
    """Absolute dotted names that a module imports, also inside functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""
            if (node.module or "").startswith(PACKAGE):
                yield from (f"{node.module}.{alias.name}" for alias in node.names)


MODULES = {name_of(path): path for path in sorted(ROOT.rglob("*.py"))}
PURE_MODULES = [name for name in MODULES if is_pure(name)]


def own(imported: str) -> str | None:
    """Which module of ours an imported name is in; None: another library's."""
    if imported != PACKAGE and not imported.startswith(f"{PACKAGE}."):
        return None
    name = imported.removeprefix(PACKAGE).removeprefix(".")
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name


def test_there_is_something_to_hold() -> None:
    assert len(PURE_MODULES) > 20
    assert {"estimation.tracker", "pipeline", "sensors.nmea"} <= set(PURE_MODULES)


@pytest.mark.parametrize("name", PURE_MODULES)
def test_a_pure_room_imports_only_pure_rooms_and_arithmetic(name: str) -> None:
    libraries = (
        CALIBRATION_LIBRARIES if is_in(name, ("calibration",)) else ALLOWED_LIBRARIES
    )
    for imported in imports_of(MODULES[name]):
        module = own(imported)
        if module is not None:
            assert module == "" or is_pure(module), f"{name} imports {imported}"
            continue
        library = imported.partition(".")[0]
        assert library not in FORBIDDEN, f"{name} imports {imported}"
        assert library in libraries | sys.stdlib_module_names, (
            f"{name} imports {imported}"
        )


@pytest.mark.parametrize("name", PURE_MODULES)
def test_a_pure_room_reads_no_clock_and_opens_no_file(name: str) -> None:
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"open", "print", "input"}, name
        if isinstance(node, ast.Attribute):
            assert node.attr not in {"now", "utcnow", "today"}, name


@pytest.mark.parametrize("name", [n for n in MODULES if not is_in(n, TOP)])
def test_nobody_imports_the_command_line(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        module = own(imported)
        assert module is None or not is_in(module, TOP), f"{name} imports {imported}"


@pytest.mark.parametrize("name", [n for n in MODULES if is_in(n, ("sensors",))])
def test_the_sensors_know_nothing_of_estimation_or_outputs(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        module = own(imported) or ""
        assert not is_in(module, ("estimation", "outputs", "pipeline", "daemon"))


def test_estimators_know_nothing_of_the_tracker() -> None:
    for name in MODULES:
        if not is_in(name, ("estimation",)) or name == "estimation.tracker":
            continue
        for imported in imports_of(MODULES[name]):
            assert own(imported) not in ("estimation.tracker", "estimation.utc"), name


DANGEROUS = {
    *("subprocess", "pty", "multiprocessing", "pickle", "marshal", "shelve", "dill"),
    *("socketserver", "http", "xmlrpc", "asyncio", "ctypes", "code", "runpy"),
}
"""Modules that start programs, run what they read, or listen to the network."""

DANGEROUS_CALLS = {"eval", "exec", "compile", "__import__"}
DANGEROUS_METHODS = {
    *("system", "popen", "fork", "forkpty", "execv", "execve", "execvp", "spawnv"),
    *("posix_spawn", "bind", "listen", "accept"),
}


@pytest.mark.parametrize("name", MODULES)
def test_nothing_runs_a_shell_unpickles_evaluates_or_listens(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        assert imported.partition(".")[0] not in DANGEROUS, f"{name} imports {imported}"
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in DANGEROUS_CALLS, name
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            assert node.func.attr not in DANGEROUS_METHODS, name
        if isinstance(node, ast.keyword):
            assert node.arg not in ("shell", "allow_pickle"), name


@pytest.mark.parametrize(
    "arguments", [["--help"], ["status", "--help"], ["replay", "--help"]]
)
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    heavy = ("scipy", "matplotlib", "numpy", "filterpy")
    code = (
        "import sys\n"
        "from imu_tracker.cli import main\n"
        "try:\n"
        f"    main({arguments!r})\n"
        "except SystemExit:\n"
        "    pass\n"
        f"print([m for m in {heavy!r} if m in sys.modules], file=sys.stderr)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "usage" in found.stdout
    assert found.stderr.strip() == "[]"
