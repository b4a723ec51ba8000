"""What is wrong with an installation, how that shows, and what to do about it.

Each rule looks at figures of the whole recording, never at one instant. Its limit lies
where sound recordings do not come near; the comment beside it says what they show.
"""

import math
from collections.abc import Iterator
from typing import Final

from imu_tracker.check.chip import GRAVITY_G
from imu_tracker.report.collect import Collected, Sensors
from imu_tracker.report.finding import Finding, Weight
from imu_tracker.report.measures.imu_log import ImuFigures
from imu_tracker.report.receiver_findings import receiver_findings

YAW_DEG: Final = 25.0
"""Glued in by hand is 2 deg, a telephone in its holder 10."""

RATTLE_DPS: Final = 8.0
"""Jolts from sample to sample while driving: firm boxes 0.6 (asphalt), 1.6 (cobbles),
a telephone in its holder 4."""

SHAKEN_MPS2: Final = 5.0
"""Vibration while driving: firm boxes 0.7 to 1.6."""

SLOPE_DPS_PER_DEGC: Final = 0.08
"""PS-MPU-6000A section 6.1 allows 20 deg/s over 65 K, 0.3; sound boards stay below
0.03."""

CHANGE_DPS: Final = 0.7
BIAS_DPS: Final = 12.0
NOISE_DPS: Final = 0.4
"""At rest, 42 Hz: the datasheet's chip has 0.05, a poor one 0.15."""

GRAVITY_OFF: Final = 0.11
"""PS-MPU-6000A section 6.2: zero-g to 80 mg, ranges to 3 %."""

COLD_DEGC: Final = 10.0
WARMED_K: Final = 8.0

MISSING_SHARE: Final = 0.01
RATE_OFF: Final = 0.03  # the chip's clock is good to 1 %
INSIDE_SHARE: Final = 0.85
LEAST_FIXES: Final = 100


def findings_of(collected: Collected) -> list[Finding]:
    """Judge what was collected; the worst first."""
    found = list(_of_track(collected))
    if collected.sensors is not None:
        found += _of_sensors(collected.sensors, collected.length_s)
    return sorted(found, key=lambda finding: finding.weight)


def _of_track(collected: Collected) -> Iterator[Finding]:
    track = collected.track
    if not track.rows:
        yield Finding(
            "no_rows",
            Weight.BAD,
            "There is no track",
            "Rows begin with the first accepted fix, and there was none.",
            "The findings about the receiver say why.",
        )
    if collected.is_cut:
        yield Finding(
            "cut",
            Weight.NOTE,
            "The recording is cut at its end",
            "The last line is torn, as after a power loss; all before it was used.",
            "Nothing, unless it happens each time: then the power supply, or the card, "
            "is failing.",
        )
    back = [outage for outage in track.outages if not math.isnan(outage.miss_m)]
    wrong = [outage for outage in back if not outage.is_true]
    if len(wrong) > max(1.0, 0.1 * len(back)):
        yield Finding(
            "outages_off",
            Weight.POOR,
            "After outages it was further off than it said",
            f"At the end of {len(wrong)} of {len(back)} outages the next fix lay "
            "outside the radius.",
            "See what is said about the mounting; for a car set filter.profile = "
            '"vehicle".',
        )
    overall = track.overall()
    is_judged = overall is not None and overall.fixes >= LEAST_FIXES
    if overall is not None and is_judged and overall.inside < INSIDE_SHARE:
        yield Finding(
            "radius",
            Weight.POOR,
            "The receiver is less exact than it says",
            f"Only {overall.inside:.0%} of its fixes lie where track and radius, and "
            "the receiver's own figure, say; 95 % should.",
            "Give the antenna more sky; a receiver that smooths, or holds its place "
            "at stops, does it too.",
        )


def _of_sensors(sensors: Sensors, length_s: float) -> Iterator[Finding]:
    yield from receiver_findings(sensors.receiver, length_s)
    imu, counters = sensors.imu, sensors.result["counters"]
    if suspects := counters.get("suspect_fixes", 0):
        yield Finding(
            "gps_suspect",
            Weight.BAD,
            "The receiver may have been led astray",
            f"{suspects} fixes drifted away without any motion that explains it.",
            "Reflections under a roof do that, and so does a jammer or spoofer nearby.",
        )
    if imu is None:
        yield Finding(
            "imu_silent",
            Weight.BAD,
            "No samples of the IMU",
            "The track is that of the GPS alone.",
            "Run imu-tracker check: it probes the chip and says what to mend.",
        )
        return
    if counters.get("stuck_samples", 0):
        text = next((n.text for n in sensors.notices if "stuck" in n.text), "")
        yield Finding(
            "imu_stuck",
            Weight.BAD,
            "The IMU is half dead: an axis does not move any more",
            f"Since then: {text.removeprefix('imu: ')}." if text else "",
            "Run imu-tracker selftest; if it fails, replace the module.",
        )
    yield from _mounting(imu, sensors)
    yield from _chip(imu)
    yield from _bus(imu)


def _mounting(imu: ImuFigures, sensors: Sensors) -> Iterator[Finding]:
    """Tell a box that lies otherwise than configured from one that comes loose."""
    is_loose = imu.tilt_changes >= 2 or imu.rattle_dps > RATTLE_DPS
    if is_loose:
        shows = []
        if imu.tilt_changes >= 2:
            shows.append(
                f"From stop to stop it lay differently, {imu.tilt_changes} times by "
                "more than a slope explains."
            )
        if imu.rattle_dps > RATTLE_DPS:
            shows.append(
                f"While driving it is jolted by {imu.rattle_dps:.0f} deg/s from sample "
                "to sample; a firm box by 1 to 4."
            )
        yield Finding(
            "loose_box",
            Weight.BAD,
            "The box is loose",
            " ".join(shows),
            "Screw it, or glue it, to something stiff of the vehicle itself: not to a "
            "mat, a cover or a cable.",
        )
        return  # it explains the rest
    if turn := max(imu.tilts_deg, default=0.0) * (imu.tilt_changes == 1):
        yield Finding(
            "box_turned",
            Weight.BAD,
            "The box was turned during the drive",
            f"After one of the stops it lay {turn:.0f} deg otherwise than before.",
            "Fasten it. Until it is learnt again the track is worse, each time.",
        )
    if imu.wrong_mount is not None:
        axes = ", ".join(f'"{axis}"' for axis in imu.wrong_mount)
        yield Finding(
            "box_turned",
            Weight.BAD,
            "The box is turned: it lies otherwise than imu.mount says",
            f"Standing still, gravity points {imu.lean_deg:.0f} deg away from down.",
            f"Set imu.mount = [{axes}], where the first axis is the one that points "
            "forward; turn the last two with it. Or turn the box.",
        )
    yaw_deg = _learnt_yaw_deg(sensors)
    said = [n for n in sensors.notices if "IMU contradicts the receiver" in n.text]
    if abs(yaw_deg) > YAW_DEG and imu.wrong_mount is None:
        side = "right" if yaw_deg > 0.0 else "left"
        yield Finding(
            "box_turned",
            Weight.POOR,
            "The box is turned about the vertical",
            f"Its forward axis points {abs(yaw_deg):.0f} deg to the {side} of where "
            "the vehicle drives.",
            "It is learnt and taken into account, but only after some minutes of "
            "driving. Set imu.mount to how it lies, or turn it, and run imu-tracker "
            "calibrate mount.",
        )
    elif said:
        yield Finding(
            "imu_contradicts",
            Weight.POOR,
            "The IMU contradicted the receiver",
            f"{len(said)} times, the first after {said[0].t_s:.0f} s; the track was "
            "the receiver's meanwhile.",
            "Was the box turned or shaken loose, or the receiver in reflections?",
        )
    if imu.vibration_mps2 > SHAKEN_MPS2 or imu.clipped > 20:
        yield Finding(
            "vibration",
            Weight.POOR,
            "It is shaken hard",
            f"{imu.vibration_mps2:.1f} m/s^2 while driving"
            f"; {imu.clipped} samples at the end of the range.",
            "Damp the mount, or set imu.accel_range_g higher.",
        )


def _learnt_yaw_deg(sensors: Sensors) -> float:
    """Angle of the box about the vertical, when it is known; else 0."""
    learnt = sensors.result["learnt"]
    angles, sigmas = learnt.get("mounting_deg"), learnt.get("mounting_sigma_deg")
    if not angles or not sigmas or sigmas[-1] > 5.0:
        return 0.0
    return float(angles[-1])


def _chip(imu: ImuFigures) -> Iterator[Finding]:
    """Tell a chip that is worse than its datasheet."""
    shows = []
    if imu.bias_dps_per_degc > SLOPE_DPS_PER_DEGC:
        shows.append(
            f"Its zero moves by {imu.bias_dps_per_degc:.2f} deg/s for each degree."
        )
    if imu.bias_change_dps > CHANGE_DPS:
        shows.append(f"It moved by {imu.bias_change_dps:.1f} deg/s during the drive.")
    if imu.bias_dps > BIAS_DPS:
        shows.append(f"At rest the gyro reads {imu.bias_dps:.0f} deg/s.")
    if abs(imu.gravity_g - 1.0) > GRAVITY_OFF:
        shows.append(f"Standing, it feels {imu.gravity_g:.2f} g instead of 1.")
    if shows and imu.noise_dps > NOISE_DPS:  # alone, an engine may do it
        shows.append(
            f"Standing, it trembles by {imu.noise_dps:.1f} deg/s; the datasheet's has "
            "0.05."
        )
    if not shows:
        return
    low, high = imu.temps_degc
    is_cold = low < COLD_DEGC or high - low > WARMED_K
    if is_cold:
        shows.append(f"It went from {low:.0f} to {high:.0f} \N{DEGREE SIGN}C.")
    is_broken = not GRAVITY_G[0] <= imu.gravity_g <= GRAVITY_G[1]
    is_broken = is_broken and not math.isnan(imu.gravity_g)
    yield Finding(
        "chip",
        Weight.BAD if is_broken or is_cold else Weight.POOR,
        "The chip is poor, a clone perhaps" + (", and it was cold" if is_cold else ""),
        " ".join(shows),
        "Run imu-tracker selftest, then imu-tracker calibrate gyro and accel. Let it "
        "warm up for ten minutes before the first tunnel, or put it where the "
        "temperature is even. A chip from another source costs two euros.",
    )


def _bus(imu: ImuFigures) -> Iterator[Finding]:
    """Tell samples that are missing, or come at another rate."""
    if imu.missing_share > MISSING_SHARE:
        yield Finding(
            "imu_gaps",
            Weight.POOR,
            "Samples of the IMU are missing",
            f"{imu.gaps} times, the longest for {imu.longest_gap_s:.1f} s; "
            f"{imu.missing_share:.1%} of the time.",
            "Short wires, a common ground, and pull-ups on SDA and SCL; imu-tracker "
            "setup sets the bus to 400 kHz.",
        )
    if abs(imu.rate_hz / imu.nominal_hz - 1.0) > RATE_OFF:
        yield Finding(
            "imu_rate",
            Weight.NOTE,
            "The IMU runs at another rate than configured",
            f"{imu.rate_hz:.1f} samples a second instead of {imu.nominal_hz:.1f}.",
            "A chip under another name, or a bus that is too slow for the rate.",
        )
