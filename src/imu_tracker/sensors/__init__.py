"""Edge, in: the bus, the MPU-6050, the receiver, and the clock that paces them."""
