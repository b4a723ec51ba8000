import re

from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import HEADER, format_row
from support.log_states import START_UTC_S, state

SHAPE = re.compile(
    r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z,-?\d{1,2}\.\d{8},-?\d{1,3}\.\d{8},"
    r"(-?\d+\.\d)?,\d+\.\d\d,(\d{1,3}\.\d)?,\d+\.\d\d,(gpsonly|still|gps|dr)"
)
NEGATIVE_ZERO = re.compile(r",-0\.0*,")


@given(
    second=st.integers(0, 10**9).map(lambda tenths: tenths / 10),
    lat_deg=st.floats(-90, 90),
    lon_deg=st.floats(-540, 540),
    alt_m=st.none() | st.floats(-500, 20_000),
    v_ne_mps=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    r95_m=st.floats(0, 1e6),
    mode=st.sampled_from(Mode),
)
def test_a_row_says_what_the_state_says_and_never_less_radius(
    second: float,
    lat_deg: float,
    lon_deg: float,
    alt_m: float | None,
    v_ne_mps: tuple[float, float],
    r95_m: float,
    mode: Mode,
) -> None:
    row = format_row(
        state(
            second,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            v_ne_mps=v_ne_mps,
            r95_m=r95_m,
            mode=mode,
        )
    )
    fields = dict(zip(HEADER.split(","), row.split(","), strict=True))

    assert SHAPE.fullmatch(row)
    assert not NEGATIVE_ZERO.search(row)
    assert fields["time_utc"].endswith("00Z")
    assert abs(float(fields["lat_deg"]) - lat_deg) < 0.6e-8
    assert -180 < float(fields["lon_deg"]) <= 180
    turns = (float(fields["lon_deg"]) - lon_deg) / 360
    assert abs(turns - round(turns)) * 360 < 0.6e-8
    assert (fields["course_deg"] == "") == (float(fields["speed_mps"]) < 0.3)
    assert float(fields["course_deg"] or 0) < 360
    assert r95_m - 1e-9 <= float(fields["r95_m"]) < r95_m + 0.0101
    assert (fields["alt_m"] == "") == (alt_m is None)


@given(st.integers(0, 10**9), st.sampled_from([1, 2, 4, 5, 8, 10]))
def test_the_instants_of_the_grid_grow_in_the_log(tick: int, rate_hz: int) -> None:
    now, then = (
        format_row(state()._replace(utc_s=START_UTC_S + n / rate_hz)).split(",")[0]
        for n in (tick, tick + 1)
    )

    assert now < then
