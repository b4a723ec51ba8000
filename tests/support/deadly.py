"""A job that takes its worker with it, for tests of `batch`, in a process of its own.

Called as `python -m support.deadly FOLDER OUTPUT`; prints the lines as JSON.
"""

import json
import os
import signal
import sys
from pathlib import Path

from imu_tracker.batch import cluster
from imu_tracker.batch.jobs import Job, Line, find_jobs, run_job


def run(job: Job) -> Line:
    """Track a recording, but die of the deadly one."""
    if "deadly" in job.name:
        os.kill(os.getpid(), signal.SIGKILL)
    return run_job(job)


def main(folder: str, output: str) -> None:
    """Run all with a worker of a scheduler that stands at an address."""
    jobs = find_jobs([folder], Path(output), None, [])
    with cluster.workers(None, 1) as here:
        address = here.scheduler.address
        with cluster.workers(address) as client:
            print(json.dumps(list(cluster.results(client, jobs, run))))


if __name__ == "__main__":
    main(*sys.argv[1:])
