"""What hypothesis draws from for the laws of the estimation."""

import math

from hypothesis import strategies as st

from imu_tracker.geometry.rotation import normalise

unit_quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(normalise)
)
vectors = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
angles = st.floats(-50.0, 50.0)
latitudes = st.floats(-math.radians(89.9), math.radians(89.9))
longitudes = st.floats(-math.pi, math.pi, exclude_max=True)
metres = st.floats(-2000.0, 2000.0)
int16 = st.integers(-32768, 32767)
bursts = st.binary(min_size=14, max_size=14)
