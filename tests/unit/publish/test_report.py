"""What `publish` tells of itself, read by Prometheus' own parser."""

import json
from collections.abc import Sequence
from pathlib import Path
from threading import Event
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.publish.cursor import Cursor
from imu_tracker.publish.outbox import Outbox, Selection
from imu_tracker.publish.report import describe, exposition
from imu_tracker.publish.senders.sender import DestinationError, Item
from imu_tracker.publish.thinning import Rules
from imu_tracker.publish.waiting import Waiting
from imu_tracker.publish.worker import Worker
from support.published import drive, write_log


class Refusing:
    """A sender that takes two rows and then no more."""

    window = 5

    def __init__(self) -> None:
        self.taken = 0

    def open(self) -> None:
        pass

    def send(self, items: Sequence[Item]) -> None:
        pass

    def wait(self, timeout_s: float) -> tuple[int, int]:
        if self.taken:
            raise DestinationError("it is full")
        self.taken = 2
        return 2, 1

    def probe(self) -> str:
        return ""

    def close(self) -> None:
        pass


def test_what_is_told_of_a_destination(tmp_path: Path) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, drive(50))
    config = PublishConfig(
        name="a", kind="mqtt", url="mqtt://broker", cursor_dir=tmp_path
    )
    cursor = Cursor(tmp_path, "a")
    outbox = Outbox(log, Selection(Rules(moving_s=0)), None)
    worker = Worker("a", outbox, cursor, Refusing(), Event(), is_once=True)
    waiting = Waiting(log, [worker])
    worker.run()
    waiting.count()
    found = describe([config], [worker], waiting, 0, worker.error_ns or 0)
    waiting.close()
    told = found["destinations"]["a"]
    assert told["kind"] == "mqtt json"
    assert told["to"] == "broker:1883"
    assert told["state"] == "failing"
    assert told["last_error"] == "it is full"
    assert told["error_age_s"] == 0
    assert (told["sent_rows"], told["refused_rows"], told["errors"]) == (1, 1, 1)
    assert told["unsent_rows"] == 48
    assert told["last_row"] == "2026-11-22T12:00:00.250Z"
    assert told["oldest_unsent"] == "2026-11-22T12:00:00.500Z"
    assert told["oldest_unsent_age_s"] == 11.8
    assert "40.0" not in json.dumps(found)  # no position

    families = text_string_to_metric_families(exposition(found))
    samples: dict[str, Any] = {
        sample.name: (sample.labels, sample.value)
        for family in families
        for sample in family.samples
    }
    here = {"destination": "a"}
    assert samples["imu_tracker_publish_unsent_rows"] == (here, 48)
    assert samples["imu_tracker_publish_failing"] == (here, 1)
    assert samples["imu_tracker_publish_sent_rows_total"] == (here, 1)
    assert samples["imu_tracker_publish_oldest_unsent_age_seconds"] == (here, 11.8)
