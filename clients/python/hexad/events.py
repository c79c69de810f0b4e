# SPDX-License-Identifier: Apache-2.0
"""Streams of events that go on where they were interrupted."""
from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any, Iterable, Iterator

from .transport import FIRST_PAUSE_S, LOST, Transport, with_query

__all__ = ["ENDED", "Event"]

ENDED = ("succeeded", "failed", "cancelled", "timed_out")


@dataclass(frozen=True)
class Event:
    """What has happened to a job.

    id: where a stream may continue; of progress and of local jobs empty
    type: `state`, `started`, `ended` (an attempt), `progress`; `position` says that events are missing (`data`: why)
    data: its members; see Event in the service's OpenAPI document
    """

    id: str
    type: str
    data: dict[str, Any]

    @property
    def job(self) -> str | None:
        return self.data.get("job")

    @property
    def state(self) -> str | None:
        return self.data.get("state")

    @property
    def progress(self) -> dict[str, Any] | None:
        return self.data.get("progress")

    @property
    def is_end(self) -> bool:
        """Whether it is the end of its job."""
        return self.type == "state" and self.state in ENDED


def parse(lines: Iterable[bytes]) -> Iterator[Event]:
    """The events of a text/event-stream; one that is cut off is left out."""
    fields: dict[str, str] = {}
    for line in lines:
        name, _, value = line.decode().rstrip("\r\n").partition(":")
        if name:
            fields[name] = value[1:] if value.startswith(" ") else value
        elif line == b"\n":
            if "data" in fields:
                yield Event(fields.get("id", ""), fields.get("event", "message"), json.loads(fields["data"]))
            fields = {}


def follow(transport: Transport, path: str, query: dict[str, Any], last: str | None, whole_job: bool) -> Iterator[Event]:
    """The events of a stream. When the connection is lost, another one continues after the last event. That of one job
    ends with it, others do not end."""
    while True:
        headers = {"Accept": "text/event-stream", **({"Last-Event-ID": last} if last else {})}
        connection, response = transport.open(with_query(path, query), headers)
        try:
            if response.status == 204:
                return  # nothing more will come
            for event in parse(response):
                if event.type != "progress":
                    last = event.id  # lines of progress are numbered anew when the service is started again
                if event.type != "position" or event.data.keys() & {"removed_up_to", "reset"}:
                    yield event
                if whole_job and event.is_end:
                    return
        except LOST:
            pass
        finally:
            connection.close()
        time.sleep(FIRST_PAUSE_S)
