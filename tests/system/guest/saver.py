"""Replaces a file as the daemon replaces its state, until the power fails.

What was said to be on the disk is told in memory, for the tests to compare.
"""

import json
import os
from itertools import count
from pathlib import Path

from imu_tracker.storage.atomic import replace_file

SAVED = Path("/var/lib/imu-tracker/saver.json")
TOLD = os.open("/run/imu-tracker-test-saver", os.O_WRONLY | os.O_CREAT)

for number in count(1):
    text = json.dumps({"number": number, "more": "x" * 2000})
    replace_file(SAVED, text.encode())
    os.pwrite(TOLD, b"%9d" % number, 0)
