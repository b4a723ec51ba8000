"""Numbers that no datasheet gives, grouped by model.

Those of the first group are physical quantities that several models share. All others
are tuned: chosen on recordings and simulated drives within what the text below each
allows, never on one file. Units are in the names, standard deviations are called sigma.
Constants that follow from a datasheet or a derivation stand beside their equations;
those of the hypotheses stand in their modules, with the odds that they mean.
"""

import math
from typing import Final

# ------------------------------------------------ Shared: one owner per quantity

SOFT_GATE_SIGMAS: Final = 3.0
"""An innovation beyond this inflates R to meet it: it weighs little, never nothing."""

SOFT_GATE_NIS: Final = SOFT_GATE_SIGMAS**2
"""The same for two degrees of freedom: 99 % of them are below."""

REST_SPEED_SIGMA_MPS: Final = 0.03
REST_RATE_SIGMA_RADPS: Final = math.radians(0.05)
"""A vehicle at rest still rocks: standard deviations of the mean of a second."""

LEVELLING_S: Final = 1.0
LEVELLING_SIGMA_RAD: Final = 0.2
"""The mean force of so long is the first guess of gravity; its error when the body
moves at 2 m/s^2."""

LEVELLING_SIGMA_MPS2: Final = 3.0
"""Acceleration of an unknown body, mean of a second: only over minutes gravity wins."""

ODD_MOUNTING_RAD: Final = math.radians(20.0)
"""No road tips a vehicle so far: the box was mounted, or turned, by this."""

UNKNOWN_ANGLE_VAR: Final = math.pi**2 / 3.0
"""rad^2: variance of an angle that may be anything."""

USABLE_YAW_SIGMA_RAD: Final = 0.6
"""A rotation by a yaw that is known worse than this is of no use."""

UNOBSERVED_TURN_RADPS: Final = 0.1
"""Turn rate of a body about any axis while the IMU delivers nothing."""

GYRO_DRIFT_PSD: Final = math.radians(0.002) ** 2
"""(rad/s)^2 per s, random walk of the bias: 0.1 deg/s in an hour, by temperature."""

GYRO_BIAS_SIGMA_RADPS: Final = math.radians(3.0)
"""Before it is measured: boards at 2 to 4 deg/s are common, though the datasheet
allows 20 (PS-MPU-6000A section 6.1)."""

RECEIVER_CORRELATION_S: Final = 60.0
"""Atmosphere, orbits and reflections change the error of a receiver in so long."""

ALTITUDE_FACTOR: Final = 2.0
"""Vertical over horizontal error of a receiver: all its satellites are above."""

COURSE_SPEED_MPS: Final = {"vehicle": 2.0, "walker": 0.8, "free": 2.0}
"""Speed from which the course over ground is taken for the heading."""

REVERSE_MPS: Final = 5.0
"""No vehicle reverses faster for seconds."""

ANY_SPEED_MPS: Final = 20.0
ANY_HEIGHT_VAR: Final = 100.0**2
"""Standard deviation per axis of an unknown velocity; m^2, of an unknown height."""

PAUSE_S: Final = 10.0
"""A longer time between two fixes is an outage."""

LATEST_FIX_S: Final = 3.0
"""How late a fix may come: receivers that smooth their course take up to 2 s."""

LARGEST_RADIUS_M: Final = 2e7
"""Half way round the Earth."""

# ------------------------------------------ Receiver, error-state: what a fix is worth

LASTING_VAR_SHARE: Final = 0.9
"""Of the receiver's variance: what lasts for a minute. A receiver filters its fixes;
what is new with each second is a third of its sigma."""

BEST_LASTING_SIGMA_M: Final = 0.5
"""Per axis under the best sky without corrections: air and orbits. No scatter shows
it: the lower limit of the learnt error unless the receiver claims less."""

ALTITUDE_CORRELATION_S: Final = 10.0
"""Its lasting error has no state: altitudes of so many seconds count as one."""

RESTING_CORRELATION_S: Final = 30.0
"""What is reflected to an antenna that stands changes with the satellites alone: at
rest the fixes of so long count as one. A parked tracker draws no star."""

VELOCITY_FLOOR_MPS: Final = 0.1
VELOCITY_START_MPS: Final = 0.2
VELOCITY_CEILING_MPS: Final = 1.0
"""Error of a Doppler velocity per axis: at best, before it is known, and when a
receiver differentiates positions; never so large that it counts for nothing."""

VELOCITY_CORRELATION_S: Final = 4.0
"""Correlation time of the error of a Doppler velocity: geometry of the satellites, and
the filter of the receiver."""

HOLDING_S: Final = 5.0
CATCHING_UP_S: Final = 8.0
"""Static navigation: a receiver that repeats its place for so long holds it at rest,
and follows a slow motion late for so long."""

VELOCITY_LATE_S: Final = 1.0
"""Receivers that smooth their velocities report them late by a varying second: added to
the variance when hypotheses are compared."""

ACCEL_OVER_S: Final = 0.8
"""Shortest time over which two velocities give an acceleration; below it is noise."""

VELOCITY_SMEAR_S: Final = 0.1
"""A receiver's velocity is a mean over this or more; its lag varies by manoeuvre."""

VELOCITY_LEARNING_S: Final = 30.0
NOISE_LEARNING_S: Final = 8.0
"""Time constants of the learnt variances of velocity and position."""

MIN_NIS_LEVEL: Final = 0.05
MAX_NIS_LEVEL: Final = 36.0
"""Limits of learnt over claimed variance: a claimed sigma may be four times too large
(HDOP ignores the receiver) or six times too small (it ignores reflections)."""

MAX_RECEIVER_SIGMAS: Final = 2.5
INFLATION_S: Final = 5.0
"""A lasting receiver error beyond so many sigmas becomes the filter's own uncertainty,
with this time constant."""

SHRINK_VAR_RATIO: Final = 2.0
"""A learnt variance is good to a quarter. The lasting error shrinks only when its
variance is larger by this ratio, or it would follow each fluctuation downwards."""

LONGER_SHARE: Final = 0.2
"""Share of the lasting error's variance that is added to r95: errors of orbits and
atmosphere last for hours, and the filter cannot tell them from a position."""

# ----------------------------------------------------------------------------- Vehicle

LATERAL_SIGMA_MPS: Final = 0.2
"""Sideways velocity at the rear axle: camber, wind, play of the suspension."""

SLIP_RAD_PER_MPS2: Final = 0.004
"""Slip angle of a rear tyre by lateral acceleration: 1 deg at 4 m/s^2."""

VERTICAL_RATIO: Final = 6.0
"""Vertical over lateral: hills change, springs travel, the box is not at the axle."""

SLIP_CORRELATION_S: Final = 0.3
"""Correlation time of the constraint's error: applied more often, R grows."""

REST_SHAKING_SHARE: Final = 0.1
"""Share of the gyro's scatter at rest that is left in the mean of a second."""

GENTLE_STOP_MPS: Final = 1.0
GENTLE_STOP_S: Final = 2.0
"""After a gentle stop standstill is detected early: the speed that may be left, and its
decay time. After an outage of a minute 1 m/s of it is worth 30 m."""

SLOPE_CORRELATION_S: Final = 10.0
FORWARD_CORRELATION_S: Final = 5.0
"""Correlation times of the slope (150 m of road) and of forward acceleration."""

START_SLOPE_RAD: Final = math.radians(5.0)
LEAST_SLOPE_RAD: Final = math.radians(1.0)
"""Road slope, start and lower limit: a mountain pass of 8 deg is within two sigmas, and
camber, load and mounting leave a degree."""

START_FORWARD_MPS2: Final = 1.0
LEAST_FORWARD_MPS2: Final = 0.2
"""Forward acceleration, start and lower limit: standard driving cycles have 0.7 m/s^2
rms, brisk driving half more, cruise control the limit."""

ROAD_START_WEIGHT_S: Final = 60.0
"""Weight of the start values against what is learnt of a drive."""

ROAD_MEMORY_S: Final = 600.0
"""Memory: landscape and traffic change in ten minutes."""

ROLLING_MPS: Final = 3.0
"""Below this nothing is learnt of slope and acceleration."""

# ------------------------------------------------------------------------------ Walker

START_WALK_MPS: Final = 1.5
"""Root mean square speed of a pedestrian, before it is learnt."""

WALKING_MPS: Final = 0.5
"""Below this no direction is learnt."""

START_GAIT_SCATTER_MPS: Final = 1.0
LEAST_GAIT_SCATTER_MPS: Final = 0.3
"""Scatter of a pedestrian's velocity about its mean, start and lower limit (a fifth of
the speed): stride, sway of the box, pauses."""

GAIT_LEARNING_S: Final = 15.0
WALK_SPEED_LEARNING_S: Final = 60.0
"""Time constants: a direction lasts to the next corner, a speed for longer."""

GAIT_CORRELATION_S: Final = 15.0
WALK_SPEED_CORRELATION_S: Final = 30.0
"""Correlation times of these pseudo-measurements."""

GAIT_DIRECTION_SIGMA_RAD: Final = math.radians(5.0)
"""The box turns in its pocket against the walker."""

# ------------------------------------------------------------------------ Any platform

UNKNOWN_ACCEL_PSD: Final = {"vehicle": 2.5**2, "walker": 0.5**2, "free": 2.5**2}
"""While the yaw or the IMU is unknown: a body's own acceleration, as (m/s^2)^2/Hz. A
vehicle's is 1 m/s^2 rms, and corners and stops last some six seconds; a walker turns
round within one."""

STEADY_MPS2: Final = 0.7
STEADY_SIGMA_MPS2: Final = 0.3
STEADY_CORRELATION_S: Final = 3.0
"""A body whose velocity changes by less between fixes is steady; sigma and correlation
time of the acceleration that is left. Under acceleration or in a banked turn specific
force is not gravity."""

SILENT_TURN_CORRELATION_S: Final = 5.0
SILENT_SLOPE_RAD: Final = 0.1
"""In an IMU gap turns at `UNOBSERVED_TURN_RADPS` last so long; a vehicle's tilt stays
within slopes."""

# --------------------------------------------------------------------------- Six-state

SIX_ACCEL_NOISE_PSD: Final = 0.1**2
"""White acceleration noise, (m/s^2)^2/Hz: vibration, scale and timing errors."""

SIX_ACCEL_BIAS_SIGMA_MPS2: Final = 0.15
"""Error of a level axis beside the tilt's: bias, scale, mounting yaw. 15 mg, a third of
the datasheet's zero-g tolerance (PS-MPU-6000A section 6.2)."""

SIX_UNKNOWN_ACCEL_PSD: Final = 1.5**2
"""While the yaw or the whole IMU is unknown: a vehicle's own acceleration,
1.5 m/s^2 for a second."""

SIX_CORRELATED_SHARE: Final = 0.8
"""Part of a fix's variance that lasts a minute (ionosphere, orbits, multipath): no
averaging removes it, so it is added to the radius."""

SIX_VELOCITY_SIGMA_MPS: Final = 0.15
"""Error of a Doppler velocity, per axis."""

SIX_LATENCY_SIGMA_S: Final = 0.1
"""How far the configured latency may be off."""

SIX_CRUISE_SPEED_MPS: Final = {"vehicle": 40.0, "walker": 2.0, "free": 60.0}
"""In an outage the speed's uncertainty stops growing here."""

SIX_GYRO_NOISE_PSD: Final = math.radians(0.02) ** 2
"""Angle random walk, (rad/s)^2/Hz: the datasheet's 0.005 deg/s/sqrt(Hz), four times
over for vibration and scale errors in turns."""

VELOCITY_BASE_S: Final = 4.0
"""Changes of velocity are compared over so long: the error of a tilt grows with it."""

VELOCITY_MODEL_SHARE: Final = 0.1
VELOCITY_MODEL_MPS2: Final = 0.05
"""Error of an acceleration by yaw, scale and latency: relative and absolute."""

MAX_DISTRUST: Final = 20.0
"""Largest inflation of that comparison's sigma when it does not fit, as with a receiver
whose latency is not the configured one."""

DISTRUST_SHARE: Final = 0.2
"""Smoothing of that inflation: it follows within five comparisons, 20 s."""

GRAVITY_WINDOW_MPS2: Final = 0.5
"""Gravity is trusted only while |f| is about g."""

SIX_COURSE_SIGMA_RAD: Final = math.radians(3.0)
"""Between course and heading at best: slip, wind, current."""

COURSE_MAX_RATE_RADPS: Final = 0.6
"""In a tighter turn box, antenna and axle move in different directions."""

COURSE_DELAY_SIGMA_S: Final = 0.2
"""Unknown part of the delay of a receiver's course."""

COURSE_CORRELATION_S: Final = 3.0
"""Correlation time of its errors."""

SIX_REVERSE_RAD: Final = math.radians(120.0)
REVERSE_FIXES: Final = 8
"""A course this far from the heading is a vehicle in reverse; above `REVERSE_MPS` for
so many fixes the heading was wrong."""

SIX_LATERAL_SIGMA_MPS: Final = 0.3
"""Sideways velocity of a vehicle where the box sits: tyre slip, suspension, crown."""

SIX_MAX_NIS_LEVEL: Final = 9.0
"""A claimed sigma may be three times too small; beyond, the filter is wrong."""

SIX_MAX_FADING: Final = 4.0
"""Largest growth of P at a single fix."""
