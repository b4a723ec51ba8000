"""What a release is made of: one version, its notes, its units, its package."""

import re
import runpy
import tomllib

import imu_tracker
from support.paths import REPOSITORY

PACKAGING = REPOSITORY / "packaging"
DEBIAN = PACKAGING / "debian"


def test_the_version_stands_in_one_place() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert "version" not in project["project"]
    source = REPOSITORY / project["tool"]["hatch"]["version"]["path"]
    assert f'__version__ = "{imu_tracker.__version__}"' in source.read_text("utf-8")


def test_the_notes_of_a_release_are_its_section_of_the_changelog() -> None:
    notes = runpy.run_path(str(PACKAGING / "release_notes.py"))["notes"]
    changelog = (
        "# Changelog\n\n## [Unreleased]\n\n- new\n\n"
        "## [1.2.0] - 2026-12-01\n\n### Added\n\n- this\n\n## [1.1.0]\n\n- that\n"
    )
    assert notes(changelog, "1.2.0") == "### Added\n\n- this\n"
    assert notes(changelog, "1.1.0") == "- that\n"
    assert notes(changelog, "1.3.0") == "- new\n"


def test_each_unit_starts_the_program_where_the_package_can_put_its_own() -> None:
    # packaging/debian/rules replaces this path, and fails for any other.
    units = sorted((REPOSITORY / "systemd").glob("*.service"))
    assert units
    for unit in units:
        starts = re.findall(r"^ExecStart=(\S+)", unit.read_text("utf-8"), re.MULTILINE)
        assert starts == ["/opt/imu-tracker/bin/imu-tracker"], unit


def test_a_purge_takes_the_state_of_each_unit_and_the_log_of_none() -> None:
    postrm = (DEBIAN / "imu-tracker.postrm").read_text("utf-8")
    for unit in (REPOSITORY / "systemd").glob("*.service"):
        text = unit.read_text("utf-8")
        for name in re.findall(r"^StateDirectory=(\S+)", text, re.MULTILINE):
            assert f"/var/lib/{name}" in postrm.split(), unit
    before, _, after = postrm.partition('"$IMU_TRACKER_PURGE_LOGS" = yes')
    assert "rm -rf /var/log" not in before
    assert "rm -rf /var/log/imu-tracker" in after
