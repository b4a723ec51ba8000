"""What recordings say of the settings, as TOML with its reasons.

A setting is only written where its interval is small enough to be of use; else a
comment says that the recordings cannot tell, and what would.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from imu_tracker.config import Config
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.recording.tuning import (
    STEP_M,
    Estimate,
    Trial,
    lever_arm,
    mount_of,
    seat,
    together,
)
from imu_tracker.samples import Frame, Mount, SessionHeader

INTERVAL: Final = 1.96
"""Standard deviations to either side that hold 95 %."""

LATENCY_SIGMA_S: Final = 0.05
LEVER_SIGMA_M: Final = 0.15
MOUNT_SIGMA_RAD: Final = math.radians(6.0)
MOUNT_OFF_DEG: Final = 25.0
"""Known worse, or further from any axis, nothing is written."""

BIASED_RADPS: Final = math.radians(1.0)
BIASED_MPS2: Final = 0.2
SCALED: Final = 0.01
"""What is worth a calibration (docs/calibration.md)."""

_NOISE: Final = (
    "as of a chip that is glued to the vehicle",
    "as of a box that is held well",
    "as of a box that is held badly: screw or glue it down",
    "as of a box that lies loose: screw or glue it down",
)

Stream = Iterable[SessionHeader | Frame]


class Finding(NamedTuple):
    """What one recording says.

    Attributes
    ----------
    learnt : LearnedParameters or None
        None: nothing was learnt.
    duration_s : float
    latency_s : Estimate
    lever_arm_m : list of Estimate
        Along x and y.
    mount, used_mount : Mount
        That explains it best, and the one of the recording.
    off_deg : float or None
        How far the box sits from that mount; None: it has none.
    """

    learnt: LearnedParameters | None
    duration_s: float
    latency_s: Estimate
    lever_arm_m: list[Estimate]
    mount: Mount
    used_mount: Mount
    off_deg: float | None


def find(config: Config, stream: Callable[[], Stream]) -> Finding:
    """Track a recording three or four times, and see what explains it best."""
    trial = Trial(config).run(stream())
    used = mount = mount_of(trial)
    learnt, off_deg = trial.learnt, None
    if learnt is not None and (sits := seat(learnt, mount)) is not None:
        off_deg = sits.off_deg
        if sits.mount != mount and off_deg < MOUNT_OFF_DEG:
            turned = Trial(config, mount=sits.mount).run(stream())
            again = None if turned.learnt is None else seat(turned.learnt, sits.mount)
            if again is not None and again.mount == sits.mount:
                trial, learnt = turned, turned.learnt
                mount, off_deg = again
    assert trial.settings is not None
    x, y, z = trial.settings.lever_arm_m
    arms = [Estimate(0.0, math.inf)] * 2
    if learnt is not None:
        moved = [
            Trial(config, mount=mount, lever_arm_m=arm).run(stream())
            for arm in ((x + STEP_M, y, z), (x, y + STEP_M, z))
        ]
        arms = [
            Estimate(begin + value, sigma)
            for begin, (value, sigma) in zip(
                (x, y), lever_arm(trial, moved), strict=True
            )
        ]
    duration_s = float(trial.result()["duration_s"])
    return Finding(learnt, duration_s, trial.latency_s, arms, mount, used, off_deg)


def toml(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield the lines of the settings that explain the recordings."""
    total_s = sum(each.duration_s for each in findings)
    yield f"# recordings: {len(findings)}, minutes: {total_s / 60.0:.0f}"
    known = [each for each in findings if each.learnt is not None]
    if not known:
        yield "# cannot tell anything: no recording with samples and fixes that move"
        return
    learnt = [each.learnt for each in known if each.learnt is not None]
    yield ""
    yield "[imu]"
    yield from _mount(known)
    yield ""
    yield "[gps]"
    yield from _latency(known)
    yield from _lever_arm(known)
    yield ""
    yield "[filter]"
    yield from _profile(learnt)
    yield ""
    yield from _noise(learnt)
    yield from _calibration(learnt)


def _mount(findings: Sequence[Finding]) -> Iterator[str]:
    told = [each for each in findings if _tells_mount(each)]
    if not told:
        yield "# mount: cannot tell; it shows in a vehicle that turns and stops"
        return
    mounts = Counter(each.mount for each in told)
    mount, n = mounts.most_common(1)[0]
    if n < len(told):
        yield "# mount: cannot tell; the recordings contradict each other"
        return
    off_deg = max(each.off_deg or 0.0 for each in told)
    used = {each.used_mount for each in told}
    word = "as recorded" if used == {mount} else "not as recorded: the box sits turned"
    yield f"# {word}; up to {off_deg:.0f} deg askew, which is learnt"
    yield f"mount = [{', '.join(chr(34) + axis + chr(34) for axis in mount)}]"


def _tells_mount(finding: Finding) -> bool:
    learnt = finding.learnt
    return (
        learnt is not None
        and finding.off_deg is not None
        and finding.off_deg < MOUNT_OFF_DEG
        and max(learnt.mounting_sigma_rad) < MOUNT_SIGMA_RAD
    )


def _latency(findings: Sequence[Finding]) -> Iterator[str]:
    found = together([each.latency_s for each in findings])
    if found is None:
        yield "# latency_s: cannot tell; it differs between the recordings"
    elif found.sigma > LATENCY_SIGMA_S:
        yield "# latency_s: cannot tell; it shows when a body speeds up and stops"
    elif not 0.0 <= found.value <= 2.0:
        yield f"# latency_s: cannot be {found.value:.2f}; look at the clocks"
    else:
        yield f'# {_interval(found, "s")}; "auto" learns it in each run'
        yield f"latency_s = {found.value:.2f}"


def _lever_arm(findings: Sequence[Finding]) -> Iterator[str]:
    axes = [together([each.lever_arm_m[i] for each in findings]) for i in (0, 1)]
    if any(axis is None for axis in axes):
        yield "# lever_arm_m: cannot tell; the recordings contradict each other"
        return
    told = [axis for axis in axes if axis is not None]
    if max(axis.sigma for axis in told) > LEVER_SIGMA_M:
        yield "# lever_arm_m: cannot tell; it shows in tight turns, and with a velocity"
        return
    x, y = told
    yield f"# x {_interval(x, 'm')}, y {_interval(y, 'm')}; z: cannot tell"
    yield f"lever_arm_m = [{x.value:.2f}, {y.value:.2f}, 0.0]"


def _profile(learnt: Sequence[LearnedParameters]) -> Iterator[str]:
    profiles = Counter(each.profile for each in learnt)
    profile, n = profiles.most_common(1)[0]
    if n < len(learnt):
        yield f"# profile: cannot tell; {', '.join(sorted(profiles))}"
    elif profile == "free":
        yield "# profile: cannot tell; no turns of a vehicle and no steps of a walker"
    else:
        yield f'profile = "{profile}"'


def _noise(learnt: Sequence[LearnedParameters]) -> Iterator[str]:
    level = max(each.noise_level for each in learnt)
    yield f"# noise: {_NOISE[min(level, len(_NOISE) - 1)]}"


def _calibration(learnt: Sequence[LearnedParameters]) -> Iterator[str]:
    """Say what the last recording learnt that a calibration would know."""
    last = learnt[-1]
    biases = last.gyro_bias_radps, last.gyro_bias_sigma_radps
    yield from _error("gyro bias", *biases, BIASED_RADPS, math.degrees(1.0), "deg/s")
    biases = last.accel_bias_mps2, last.accel_bias_sigma_mps2
    yield from _error("accel bias", *biases, BIASED_MPS2, 1.0, "m/s^2")
    scales = last.gyro_gain[::4], last.gyro_gain_sigma[::4]
    yield from _error("gyro scale", *scales, SCALED, 100.0, "%")


def _error(
    name: str,
    values: Sequence[float],
    sigmas: Sequence[float],
    most: float,
    factor: float,
    unit: str,
) -> Iterator[str]:
    """Say how far off the worst axis of a sensor is, if that is worth a calibration."""
    worst = max(range(3), key=lambda i: abs(values[i]))
    value, sigma = values[worst], sigmas[worst]
    name = f"# {name}, {'xyz'[worst]}"
    if abs(value) > most + INTERVAL * sigma:
        found = _interval(Estimate(value * factor, sigma * factor), unit)
        yield f"{name}: {found}, learnt anew in each run; {_CURE[name.split(',')[0]]}"
    elif INTERVAL * sigma > most:
        yield f"{name}: cannot tell"


_CURE: Final = {
    "# gyro bias": "`imu-tracker calibrate gyro` takes it away",
    "# accel bias": "`imu-tracker calibrate accel` takes it away",
    "# gyro scale": "nothing to do",
}


def _interval(found: Estimate, unit: str) -> str:
    reach = INTERVAL * found.sigma
    return f"{found.value - reach:.2f} to {found.value + reach:.2f} {unit}"
