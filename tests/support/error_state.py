"""An error-state filter in a state that the test chooses."""

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.states import NoiseLevel
from imu_tracker.geometry.rotation import from_euler
from imu_tracker.samples import Vec3

NOISE = NoiseLevel(gyro_share=0.1, accel_share=0.1)


def moving(v_n: Vec3, yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> Eskf:
    eskf = Eskf(NOISE, is_vehicle=True)
    q_nb = from_euler(0.0, pitch_rad, yaw_rad)
    eskf.nominal = Nominal(0, (0.0, 0.0, 0.0), v_n, q_nb)
    return eskf
