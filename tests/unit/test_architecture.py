"""The rule of the house: who may import what, read from the sources."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import imu_tracker
from support.paths import REPOSITORY

ROOT = Path(imu_tracker.__file__).parent
PACKAGE = "imu_tracker"

PURE = (
    *(
        "samples",
        "errors",
        "notices",
        "geometry",
        "motion",
        "estimation",
        "calibration",
    ),
    *("simulation", "wheels", "pipeline"),
    *(
        f"sensors.gnss.{name}"
        for name in (
            *("lines", "fields", "sentences", "epoch", "calendar", "verdicts"),
        )
    ),
    "sensors.gnss.epoch_reader",
)
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
    return is_in(name, PURE)


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
    assert {"estimation.tracker", "pipeline", "sensors.gnss.lines"} <= set(PURE_MODULES)


@pytest.mark.parametrize("name", PURE_MODULES)
def test_a_pure_room_imports_only_pure_rooms_and_arithmetic(name: str) -> None:
    libraries = (
        CALIBRATION_LIBRARIES if is_in(name, ("calibration",)) else ALLOWED_LIBRARIES
    )
    for imported in imports_of(MODULES[name]):
        module = own(imported)
        if module is not None:
            assert module == "" or is_pure(module), (
                f"{name} is pure and imports {imported}, which is not: take the"
                " value as an argument, or move the line to the room that calls"
            )
            continue
        library = imported.partition(".")[0]
        assert library not in FORBIDDEN, (
            f"{name} is pure and imports {imported}: clocks, files, threads and logs"
            " belong in sensors, storage, recording, daemon or commands"
        )
        assert library in libraries | sys.stdlib_module_names, (
            f"{name} is pure and imports {imported}: only {sorted(libraries)} and the"
            " standard library may be used there"
        )


@pytest.mark.parametrize("name", PURE_MODULES)
def test_a_pure_room_reads_no_clock_and_opens_no_file(name: str) -> None:
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"open", "print", "input"}, (
                f"line {node.lineno} of {name} calls {node.func.id}(): files belong in"
                " storage or recording, words for people in commands"
            )
        if isinstance(node, ast.Attribute):
            assert node.attr not in {"now", "utcnow", "today"}, (
                f"line {node.lineno} of {name} reads a clock: time comes with samples"
                " and fixes, as t_ns; clocks belong in sensors/clock.py"
            )


@pytest.mark.parametrize("name", [n for n in MODULES if not is_in(n, TOP)])
def test_nobody_imports_the_command_line(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        module = own(imported)
        assert module is None or not is_in(module, TOP), (
            f"{name} imports {imported}: what both need belongs in the room that does"
            " the work; commands only call it"
        )


@pytest.mark.parametrize("name", [n for n in MODULES if is_in(n, ("sensors",))])
def test_the_sensors_know_nothing_of_estimation_or_outputs(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        module = own(imported) or ""
        assert not is_in(module, ("estimation", "storage", "pipeline", "daemon")), (
            f"{name} imports {imported}: sensors deliver frames and know no reader of"
            " them; join the two in sources or daemon"
        )


@pytest.mark.parametrize("program", ["serve.server", "publish.program"])
def test_programs_beside_the_daemon_load_neither_sensors_nor_estimation(
    program: str,
) -> None:
    code = (
        "import sys\n"
        f"import imu_tracker.{program}\n"
        "rooms = ('estimation', 'sensors', 'daemon', 'pipeline', 'sources')\n"
        "print([m for m in sys.modules for room in rooms"
        " if m.startswith(f'imu_tracker.{room}')], 'numpy' in sys.modules)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[] False", (
        f"serve loads {found.stdout}: it reads the log and the status file, and what it"
        " needs of other rooms belongs in storage, samples or guidance"
    )


CLOCKS = ("estimation.tracker", "estimation.rows", "estimation.receiver.utc")


def test_estimators_know_nothing_of_the_tracker() -> None:
    for name in MODULES:
        if not is_in(name, ("estimation",)) or name in CLOCKS:
            continue
        for imported in imports_of(MODULES[name]):
            assert own(imported) not in CLOCKS, (
                f"{name} imports {imported}: order and time of events belong in"
                " estimation/tracker.py; hand the instant in"
            )


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


SERVER = ("serve",)
"""The only room that listens; it has neither sensors nor estimation."""

CLIENT = ("publish.senders",)
"""The only room that makes requests of its own, by HTTP."""

MAY_BIND = "sensors.gnss.network_port"  # udp://, which only receives


MAY_START_PROGRAMS = "setup.actions"  # by lists of words, at the user's word


@pytest.mark.parametrize("name", MODULES)
def test_nothing_runs_a_shell_unpickles_evaluates_or_listens(name: str) -> None:
    libraries = DANGEROUS - ({"asyncio"} if is_in(name, SERVER) else set())
    libraries -= {"http"} if is_in(name, CLIENT) else set()
    libraries -= {"subprocess"} if name == MAY_START_PROGRAMS else set()
    methods = DANGEROUS_METHODS - ({"bind"} if name == MAY_BIND else set())
    for imported in imports_of(MODULES[name]):
        assert imported.partition(".")[0] not in libraries, (
            f"{name} imports {imported}: the product starts no programs, runs nothing"
            " that it read, and listens in serve alone"
        )
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in DANGEROUS_CALLS, (
                f"line {node.lineno} of {name} calls {node.func.id}(): parse the text"
            )
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            assert node.func.attr not in methods, (
                f"line {node.lineno} of {name} calls .{node.func.attr}(): sockets that"
                " listen belong in serve; a method of ours needs another name"
            )
        if isinstance(node, ast.keyword):
            assert node.arg not in ("shell", "allow_pickle"), (
                f"{name} passes {node.arg}=: no shell and no pickle anywhere"
            )


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
    assert found.stderr.strip() == "[]", (
        f"help loads {found.stderr.strip()}: import it in the function that uses it"
    )


MAX_FILES = 11
"""Modules in one room, its door left out: what one look takes in."""

MAX_LINES = 300

ROOMS = sorted({name.rpartition(".")[0] for name in MODULES if "." in name})


def room_of(name: str) -> str:
    """Return the room in which a module stands; a door stands in its own room."""
    return name if MODULES[name].name == "__init__.py" else name.rpartition(".")[0]


def public_of(room: str) -> set[str]:
    """Return what the door of a room names in `__all__`."""
    tree = ast.parse(MODULES[room].read_text(encoding="utf-8"))
    for node in tree.body:
        target = None
        if isinstance(node, ast.Assign):
            target = node.targets[0]
        elif isinstance(node, ast.AnnAssign):
            target = node.target
        if isinstance(target, ast.Name) and target.id == "__all__":
            assert isinstance(node, ast.Assign | ast.AnnAssign)
            assert node.value, f"__all__ of {room} is empty"
            return set(ast.literal_eval(node.value))
    return set()


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_has_a_door_that_says_what_is_in_it(room: str) -> None:
    assert room in MODULES, f"{room} wants an __init__.py with a docstring"
    text = ast.get_docstring(ast.parse(MODULES[room].read_text(encoding="utf-8"))) or ""
    for word in ("In:", "Out:", "Not here:"):
        assert word in " ".join(text.split()), f"the docstring of {room} lacks {word!r}"


@pytest.mark.parametrize("room", ROOMS)
def test_a_door_holds_no_code(room: str) -> None:
    for node in ast.parse(MODULES[room].read_text(encoding="utf-8")).body:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                continue  # the docstring
            case ast.ImportFrom(module=str() as module):
                if module.startswith(f"{PACKAGE}.{room}."):
                    continue  # a name that the room gives out
            case ast.Assign(targets=[ast.Name(id="__all__")]):
                continue
        pytest.fail(
            f"line {node.lineno} of {room}/__init__.py belongs in a module of that"
            " room: a door has a docstring, __all__ and names from its own room"
        )


@pytest.mark.parametrize("room", ROOMS)
def test_a_door_names_only_what_is_there(room: str) -> None:
    tree = ast.parse(MODULES[room].read_text(encoding="utf-8"))
    defined = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    missing = {
        name for name in public_of(room) - defined if f"{room}.{name}" not in MODULES
    }
    assert not missing, f"__all__ of {room} names {sorted(missing)}: it has moved"


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_small_enough_to_take_in(room: str) -> None:
    files = [name for name in MODULES if name.rpartition(".")[0] == room]
    files = [name for name in files if MODULES[name].name != "__init__.py"]
    assert len(files) <= MAX_FILES, f"{room} has {len(files)} files: split the room"


def test_a_file_is_short_enough_to_read_at_once() -> None:
    long = {
        name
        for name, path in MODULES.items()
        if len(path.read_text(encoding="utf-8").splitlines()) > MAX_LINES
    }
    assert not long, f"{sorted(long)}: is there a second room in it?"


@pytest.mark.parametrize("name", MODULES)
def test_nobody_reaches_past_the_door_of_a_room(name: str) -> None:
    for imported in imports_of(MODULES[name]):
        module = own(imported)
        if not module or module not in MODULES:
            continue
        room = room_of(module)
        if not room or room == module or room == room_of(name):
            continue
        leaf = module.rpartition(".")[2]
        assert leaf in public_of(room), (
            f"{name} imports {module}, which is not in __all__ of {room}: name it there"
            " if others may use it, or move the line into that room"
        )


UNIT_TESTS = REPOSITORY / "tests" / "unit"
WHOLE = {
    *("test_architecture", "test_fake_i2c", "test_figures", "test_packaging"),
    "test_pins",
}
"""Tests of the repository as a whole and of its fakes, at the top of tests/unit/."""


def test_unit_tests_stand_where_their_modules_stand() -> None:
    astray = []
    for path in sorted(UNIT_TESTS.rglob("test_*.py")):
        room = path.parent.relative_to(UNIT_TESTS).parts
        module = path.stem.removeprefix("test_")
        names_the_room = bool(room) and module == room[-1] and ".".join(room) in MODULES
        names_a_module = ".".join((*room, module)) in MODULES
        is_of_the_whole = not room and path.stem in WHOLE
        if not (names_the_room or names_a_module or is_of_the_whole):
            astray.append(str(path.relative_to(REPOSITORY)))
    assert not astray, (
        f"{astray} test no module of their rooms: move each to the folder of the room"
        " that it tests and name it after the module, or the room; whole programs are"
        " tested in tests/replay or tests/daemon"
    )


def test_helpers_of_tests_are_in_support() -> None:
    loose = {path.name for path in UNIT_TESTS.parent.glob("*.py")} - {"conftest.py"}
    assert not loose, f"move {sorted(loose)} from tests/ to tests/support/"


def test_rooms_do_not_import_each_other_in_a_circle() -> None:
    arrows: dict[str, set[str]] = {}
    for name, path in MODULES.items():
        here = room_of(name) or name
        for imported in imports_of(path):
            module = own(imported)
            there = (room_of(module) or module) if module else here
            if not is_in(here, (there,)) and not is_in(there, (here,)):
                arrows.setdefault(here, set()).add(there)
    seen: dict[str, bool] = {}

    def visit(room: str, way: tuple[str, ...]) -> None:
        if seen.get(room) is False:
            raise AssertionError(
                f"a circle of imports: {' -> '.join((*way, room))}: move what the first"
                " needs of the last into a room below both"
            )
        if seen.get(room):
            return
        seen[room] = False
        for other in sorted(arrows.get(room, ())):
            visit(other, (*way, room))
        seen[room] = True

    for room in sorted(arrows):
        visit(room, ())
