"""What the sensor's numbers mean: counts to SI and back, and how it errs."""
