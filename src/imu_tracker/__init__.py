"""Position tracking with an MPU-6050 and an NMEA GPS receiver.

This page is the contract that every module relies on, so that each can just
write `v_n` or `gyro_radps` and mean the same thing.

Pipeline
--------
Bytes off a wire become SI events, and events become estimates::

    MPU-6050, GPS, recording or simulation
        -> Frame -> ImuSample / GpsFix / UtcTime -> Tracker -> NavState -> log

Live hardware, a recording and the simulator are three producers of the same
stream of frames; `pipeline.Pipeline` is the one consumer.

Axes
----
======  =====================================================================
``s``   sensor: the axes printed on the chip; only inside `calibration`
``b``   body: x forward, y right, z down (FRD), origin at the chip
``n``   navigation: north, east, down (NED) at the local origin, WGS-84
``e``   earth-centred, earth-fixed, WGS-84
======  =====================================================================

Notation
--------
- ``v_n``, ``f_b``, ``w_b``, ``p_n``: velocity, specific force, angular rate and
  position *in* those axes. Specific force is what an accelerometer feels: at
  rest and level ``f_b = (0, 0, -9.81)`` m/s^2.
- ``q_nb``, ``C_nb`` take body to navigation: ``v_n = C_nb @ v_b``. Quaternions are
  ``(w, x, y, z)``, unit, Hamilton.
- ``x P F Q H R K S z`` keep their Kalman meaning.
- Suffixes are units: ``_ns _s _hz _m _mps _mps2 _rad _radps _deg _degc _g``.
  ``_sigma_`` is one standard deviation, ``_var`` its square, ``_psd`` a spectral
  density. SI and radians inside; degrees only in names that end in ``_deg``.

Time
----
``t_ns`` is an integer number of nanoseconds of CLOCK_MONOTONIC, the instant of
sampling. ``utc_s`` is seconds since 1970-01-01 UTC, learnt from the receiver:
UTC is data. The system clock is never read.
"""

__version__ = "0.1.0"

RELEASE_DATE = "2026-11-23"
"""What a live receiver sends of long before it has rolled over: see
`sensors.gnss.calendar`."""
