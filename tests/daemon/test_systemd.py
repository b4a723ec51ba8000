"""The files of systemd/, judged by systemd's own tools where they are."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from support.paths import REPOSITORY

SYSTEMD = REPOSITORY / "systemd"
UNIT = "imu-tracker.service"
SERVE_UNIT = "imu-tracker-serve.service"
PUBLISH_UNIT = "imu-tracker-publish.service"

pytestmark = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here"
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A file system with the unit installed as the README says, and its program."""
    units = tmp_path / "etc/systemd/system"
    units.mkdir(parents=True)
    for unit in (UNIT, SERVE_UNIT, PUBLISH_UNIT):
        shutil.copy(SYSTEMD / unit, units)
    program = tmp_path / "opt/imu-tracker/bin/imu-tracker"
    for path in (program, tmp_path / "bin/kill"):
        path.parent.mkdir(parents=True)
        path.touch(0o755)
    return tmp_path


def exposure(root: Path, unit: str = UNIT) -> float:
    """Return what `systemd-analyze security` says, 0 (best) to 10."""
    said = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", f"--root={root}", unit],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    match = re.search(r"Overall exposure level for \S+: ([\d.]+)", said)
    assert match, said
    return float(match[1])


def test_the_service_exposes_next_to_nothing(root: Path) -> None:
    assert exposure(root) <= 1.0


def test_the_server_exposes_little_for_something_that_listens(root: Path) -> None:
    assert exposure(root, SERVE_UNIT) <= 1.2


def test_the_publisher_exposes_little_for_something_that_calls_the_world(
    root: Path,
) -> None:
    assert exposure(root, PUBLISH_UNIT) <= 1.6


def test_with_network_it_exposes_little_more(root: Path) -> None:
    drop_ins = root / f"etc/systemd/system/{UNIT}.d"
    drop_ins.mkdir()
    shutil.copy(SYSTEMD / "network.conf", drop_ins)
    assert 1.0 < exposure(root) <= 1.6  # above: it was read


def test_narrowed_it_exposes_no_more(root: Path) -> None:
    broad = exposure(root)
    drop_ins = root / f"etc/systemd/system/{UNIT}.d"
    drop_ins.mkdir()
    shutil.copy(SYSTEMD / "narrow.conf", drop_ins)
    assert exposure(root) <= broad


@pytest.mark.parametrize("name", [UNIT, SERVE_UNIT, PUBLISH_UNIT])
def test_systemd_finds_nothing_wrong_with_the_unit(name: str, tmp_path: Path) -> None:
    # The program is nowhere on this machine: another stands for it.
    text = (SYSTEMD / name).read_text("utf-8")
    unit = tmp_path / name
    unit.write_text(text.replace("/opt/imu-tracker/bin/imu-tracker", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_user_can_be_made(root: Path) -> None:
    if shutil.which("systemd-sysusers") is None:
        pytest.skip("systemd-sysusers is not here")
    (root / "etc/sysusers.d").mkdir()
    shutil.copy(SYSTEMD / "imu-tracker.sysusers.conf", root / "etc/sysusers.d")
    # Debian says the number of the group dialout; that is not ours to say again.
    (root / "usr/lib/sysusers.d").mkdir(parents=True)
    (root / "usr/lib/sysusers.d/basic.conf").write_text("g dialout 20 -\n")
    done = subprocess.run(
        ["systemd-sysusers", f"--root={root}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "ignoring" not in done.stderr
    passwd = (root / "etc/passwd").read_text()
    assert re.search(r"^imu-tracker:.*:/var/lib/imu-tracker:.*nologin$", passwd, re.M)
    groups = (root / "etc/group").read_text()
    for group in ("i2c", "dialout"):
        assert re.search(rf"^{group}:.*:imu-tracker$", groups, re.M)
