"""The workers: processes of this computer, or those of a Dask cluster.

Jobs are handed out as workers become free, so that a million of them need no memory.
What a newcomer gets wrong: when a worker is killed, Dask suspects each job that it had.
So those are tried again at the end, one at a time: only the deadly one fails.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from imu_tracker.batch.jobs import Job, Line, failed_line, run_job
from imu_tracker.errors import TrackerError, UsageError

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE_S: Final = 30

log = logging.getLogger(__name__)


@contextmanager
def workers(scheduler: str | None, count: int | None = None) -> "Iterator[Client]":
    """Start workers here, or use those of a cluster.

    Parameters
    ----------
    scheduler : str, optional
        Address of a cluster's scheduler, such as tcp://host:8786.
    count : int, optional
        Processes here; as many as there are cores when left out.

    Raises
    ------
    UsageError
        When dask.distributed is not installed, or nobody answers at the address.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UsageError(
            "batch needs dask.distributed: pip install 'imu-tracker[batch]'"
        ) from error
    for name in ("distributed", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # we tell what matters
    settings = {
        "distributed.comm.timeouts.connect": f"{PATIENCE_S}s",
        "distributed.scheduler.allowed-failures": 1,
    }
    with dask.config.set(settings):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout=PATIENCE_S)
            except (OSError, ValueError, TimeoutError) as error:
                raise UsageError(
                    f"--scheduler {scheduler}: no scheduler answers there: {error}"
                ) from error
            with client:
                yield client
            return
        with (
            LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
            ) as cluster,
            Client(cluster) as client,
        ):
            yield client


def results(
    client: "Client", jobs: Sequence[Job], run: Callable[[Job], Line] = run_job
) -> Iterator[Line]:
    """Yield a line for each job, as they are done; what fails, fails alone."""
    suspects: list[Job] = []
    at_once = max(1, sum(client.nthreads().values()))
    for job, future in _futures(client, run, jobs, at_once):
        if future.status == "finished":
            yield future.result()
        elif _has_lost_its_worker(error := future.exception()):
            suspects.append(job)
        else:
            yield failed_line(job, _reason(error))
    for job, future in _futures(client, run, suspects, at_once=1):
        if future.status == "finished":
            yield future.result()
        else:
            yield failed_line(job, _reason(future.exception()))


def _futures(
    client: "Client", run: Callable[[Job], Line], jobs: Sequence[Job], at_once: int
) -> "Iterator[tuple[Job, Future]]":
    """Submit jobs, so many at once; yield them when they are over."""
    from distributed import as_completed

    running: dict[Any, Job] = {}
    done = as_completed()
    waiting = iter(jobs)

    def submit_next() -> None:
        job = next(waiting, None)
        if job is not None:
            future = client.submit(run, job, pure=False)
            running[future.key] = job
            done.add(future)

    for _ in range(min(at_once, len(jobs))):
        submit_next()
    for future in done:
        yield running.pop(future.key), future
        future.release()
        submit_next()


def _has_lost_its_worker(error: Any) -> bool:
    return type(error).__name__ == "KilledWorker"


def _reason(error: Any) -> str:
    """Say in a line why a job failed."""
    if isinstance(error, TrackerError):
        return str(error)
    if _has_lost_its_worker(error):
        return "its worker was killed each time: too little memory?"
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
