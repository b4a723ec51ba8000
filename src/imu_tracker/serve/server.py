"""The program: three ports, one loop, and what it reads ten times a second.

One thread. Nothing in here waits for a peer: what one does not take in waits in a
buffer with an end, and then it is closed.
"""

import asyncio
import contextlib
import logging
import signal
from collections.abc import Awaitable, Callable
from typing import Final

from imu_tracker.config import Config
from imu_tracker.config.serving import Address, address_of
from imu_tracker.errors import ConfigError, OutputError
from imu_tracker.serve import gpsd_session, nmea_sentences, site
from imu_tracker.serve.gpsd_session import GpsdSession
from imu_tracker.serve.http_request import MAX_HEAD
from imu_tracker.serve.peers import Peers, prepare, send
from imu_tracker.serve.site import Site
from imu_tracker.serve.view import Shown, View

POLL_S: Final = 0.1
POLLS_A_STATUS: Final = 10
STEADY_ROWS: Final = 20
"""More rows than that at once are history, which viewers get as a whole."""

VIEWERS: Final = 16
REQUESTS: Final = 64
CLIENTS: Final = 32
HEAD_S: Final = 5.0
"""So long a request may take to arrive."""
RELAY_S: Final = 1.0
"""Clients ask at once; a gpsd that relays us asks nothing, and wants reports."""

log = logging.getLogger(__name__)

Handler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


def run(config: Config) -> int:
    """Serve until SIGTERM or SIGINT; return the exit code.

    Raises
    ------
    ConfigError
        When nothing is switched on, or token or tiles cannot be used.
    OutputError
        When a port cannot be had.
    """
    serve = config.serve
    if not (serve.page or serve.gpsd or serve.nmea):
        raise ConfigError("serve.page, serve.gpsd, serve.nmea: all are off")
    asyncio.run(Server(config).run())
    return 0


class Server:
    """Everything that one run has."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._view = View(config)
        self._site = Site(config, self._view)
        self._viewers, self._requests = Peers(VIEWERS), Peers(REQUESTS)
        self._gpsd, self._nmea = Peers(CLIENTS), Peers(CLIENTS)
        self._json, self._sentences = (
            Peers(CLIENTS),
            Peers(CLIENTS),
        )  # of gpsd's clients

    async def run(self) -> None:
        """Listen and tell until it is told to end."""
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)
        serve = self._config.serve
        servers = []
        try:
            for key, text, handler in (
                ("page", serve.page, self._on_request),
                ("gpsd", serve.gpsd, self._on_gpsd),
                ("nmea", serve.nmea, self._on_nmea),
            ):
                if (address := address_of(text)) is not None:
                    servers.append(await _listen(key, address, handler))
            telling = asyncio.create_task(self._tell(stop))
            await stop.wait()
            await telling
        finally:
            for server in servers:
                server.close()
            for peers in (self._viewers, self._requests, self._gpsd, self._nmea):
                peers.close()
            self._view.close()
            self._site.close()
        log.info("ended")

    # ------------------------------------------------------------------ what is told

    async def _tell(self, stop: asyncio.Event) -> None:
        polls, is_flood = 0, False
        while not stop.is_set():
            if polls % POLLS_A_STATUS == 0:
                self._tell_status()
            polls += 1
            rows, is_more = self._view.take_rows()
            if is_more or len(rows) > STEADY_ROWS:
                is_flood = True
            elif is_flood:
                is_flood = False
                self._viewers.send(self._site.hello())
                self._tell_rows(rows[-1:])
            else:
                self._tell_rows(rows)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), 0.001 if is_more else POLL_S)

    def _tell_status(self) -> None:
        has_changed = self._view.read_status()
        self._viewers.send(self._site.status())
        if has_changed and self._view.away:
            self._json.send(gpsd_session.line(gpsd_session.no_fix()))

    def _tell_rows(self, rows: list[Shown]) -> None:
        for shown in rows:
            if len(self._viewers):
                self._viewers.send(site.row_event(shown))
            if len(self._json):
                self._json.send(gpsd_session.line(gpsd_session.tpv(shown)))
            if len(self._nmea) or len(self._sentences):
                data = self._sentences_of(shown)
                self._nmea.send(data)
                self._sentences.send(data)

    def _sentences_of(self, shown: Shown) -> bytes:
        return nmea_sentences.sentences(shown, self._config.serve.nmea_limit_m)

    # ------------------------------------------------------------------- who asks

    async def _on_request(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        if self._requests.is_full:
            return
        self._requests.add(writer)
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_S)
        finally:
            self._requests.remove(writer)
        response = self._site.answer(head)
        if not response.is_stream:
            send(writer, response.data)
            await asyncio.wait_for(writer.drain(), HEAD_S)
            return
        if self._viewers.is_full:
            send(writer, site.full())
            return
        send(writer, response.data)
        self._viewers.add(writer)
        try:
            await _until_closed(reader)
        finally:
            self._viewers.remove(writer)

    async def _on_gpsd(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        if self._gpsd.is_full:
            return
        self._gpsd.add(writer)
        session = GpsdSession()
        try:
            send(writer, gpsd_session.greeting())
            data = await _read_or(gpsd_session.RELAY, reader)
            while data:
                is_on = not self._view.away
                try:
                    send(writer, session.feed(data, self._view.last, is_on=is_on))
                except ValueError:
                    return
                for peers, wants in (
                    (self._json, session.wants_json),
                    (self._sentences, session.wants_nmea),
                ):
                    (peers.add if wants else peers.remove)(writer)
                data = await reader.read(4096)
        finally:
            for peers in (self._gpsd, self._json, self._sentences):
                peers.remove(writer)

    async def _on_nmea(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        if self._nmea.is_full:
            return
        self._nmea.add(writer)
        if self._view.last is not None and not self._view.away:
            send(writer, self._sentences_of(self._view.last))
        try:
            await _until_closed(reader)
        finally:
            self._nmea.remove(writer)


async def _read_or(default: bytes, reader: asyncio.StreamReader) -> bytes:
    """Return the first request, or what somebody means who makes none."""
    try:
        return await asyncio.wait_for(reader.read(4096), RELAY_S)
    except TimeoutError:
        return default


async def _until_closed(reader: asyncio.StreamReader) -> None:
    """Read and forget what somebody says who should only listen."""
    while await reader.read(4096):
        pass


def _guarded(handler: Handler) -> Handler:
    """Let whatever a peer does end in nothing but a closed connection."""

    async def handle(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        prepare(writer)
        try:
            await handler(reader, writer)
        except (
            OSError,
            TimeoutError,
            asyncio.IncompleteReadError,
            asyncio.LimitOverrunError,
        ) as error:
            log.debug("a connection ended: %s", error)
        finally:
            writer.close()

    return handle


async def _listen(key: str, address: Address, handler: Handler) -> asyncio.Server:
    try:
        server = await asyncio.start_server(
            _guarded(handler), address.host, address.port, limit=MAX_HEAD
        )
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f'serve.{key} = "{address}": {reason}') from error
    number = server.sockets[0].getsockname()[1]
    bound = Address(address.host, number)
    if key == "page":
        log.info("the page: %s", site.where_to_look(bound))
    else:
        log.info("%s: %s", key, bound)
        if not address.is_loopback:
            log.warning("serve.%s: every computer that reaches %s hears it", key, bound)
    return server
