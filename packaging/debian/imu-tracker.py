#!/usr/bin/python3 -sP
"""Start imu-tracker with the libraries that came with it, and no others before them."""

import sys

sys.path.insert(0, "/usr/lib/imu-tracker")

from imu_tracker.cli import main

sys.exit(main())
