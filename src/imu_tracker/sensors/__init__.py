"""Edge, inwards: bytes from the I2C bus and the receiver, with their instants.

In: wires. Out: `Frame`, and for the receiver `GpsFix`. `imu/` is the chip, `gnss/` the
receiver; the clock and the base of both reader threads are shared. Not here:
estimation, files, retry policy beyond one sensor.
"""

__all__ = ["clock", "pi_advice", "sensor_thread"]
