"""Who we are and who they are: credentials from files, certificates, and their faults.

A secret is never in a message, a log, a status or the list of processes: what is wrong
with one is said without it.
"""

import base64
import os
import socket
import ssl
import stat
import tomllib
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.publish.senders.sender import CONNECT_S, DestinationError

ETC: Final = Path("/etc/imu-tracker")

CLOCK_S: Final = 15.0
"""How often it is tried again while the clock of this computer is not set."""

_NOT_YET_VALID: Final = 9  # X509_V_ERR_CERT_NOT_YET_VALID
_EXPIRED: Final = 10  # X509_V_ERR_CERT_HAS_EXPIRED
_MAX_BYTES: Final = 10_000
_KEYS: Final = ("user", "password", "token")


class Credentials(NamedTuple):
    """What is said to prove who we are; empty where it is not used."""

    user: str = ""
    password: str = ""
    token: str = ""

    def __repr__(self) -> str:
        return "Credentials(...)"


def read_credentials(path: Path | None) -> Credentials:
    """Read `user`, `password` and `token`, of a file for its owner and group alone.

    Parameters
    ----------
    path : Path or None
        A bare name is one of systemd's credentials; without systemd, as for `check`, it
        is where the documentation lets systemd take it from.

    Raises
    ------
    DestinationError
        When there is no such file, others may read it, or it is not as it should be.
    """
    if path is None:
        return Credentials()
    if len(path.parts) == 1:
        directory = os.environ.get("CREDENTIALS_DIRECTORY")
        path = Path(directory) / path if directory else ETC / f"{path}.credentials"
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            data = file.read(_MAX_BYTES)
    except OSError as error:
        raise DestinationError(
            f"credentials_file {path}: {error.strerror or error}"
        ) from error
    if mode & (stat.S_IRWXO | stat.S_IWGRP):
        raise DestinationError(
            f"credentials_file {path}: others may read or change it: chmod 640 {path}"
        )
    try:
        found = tomllib.loads(data.decode())
    except ValueError:  # its message may hold a piece of the secret
        found = {"": ""}
    is_text = all(isinstance(v, str) and v and v.isprintable() for v in found.values())
    is_text = is_text and found.get("token", "").isascii()
    if not found or not is_text or set(found) - set(_KEYS):
        raise DestinationError(
            f"credentials_file {path}: must hold lines like "
            'user = "car", password = "..." or token = "..."'
        ) from None
    return Credentials(**found)


def authorization(credentials: Credentials, scheme: str) -> dict[str, str]:
    """Return the header of HTTP that shows them, if there are any.

    Parameters
    ----------
    credentials : Credentials
    scheme : str
        The word before a token.
    """
    if credentials.token:
        return {"Authorization": f"{scheme} {credentials.token}"}
    if credentials.user:
        pair = f"{credentials.user}:{credentials.password}".encode()
        return {"Authorization": f"Basic {base64.b64encode(pair).decode('ascii')}"}
    return {}


def tls_context(config: PublishConfig) -> ssl.SSLContext:
    """Return how the other side is verified, and how we show who we are."""
    path = config.ca_file
    try:
        context = ssl.create_default_context(cafile=path)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if (path := config.cert_file) is not None:
            # A key with a passphrase would be asked for on the terminal.
            context.load_cert_chain(path, config.key_file, password="")
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        reason = getattr(error, "strerror", None) or "no certificate, or not its key"
        if isinstance(error, ssl.SSLError):
            reason = "no certificate, or not its key"
        raise DestinationError(f"{path}: {reason}") from error
    return context


def explain(error: Exception, where: str) -> DestinationError:
    """Say what a connection failed of, and what to do."""
    match error:
        case ssl.SSLCertVerificationError(verify_code=code) if code == _NOT_YET_VALID:
            return DestinationError(
                f"{where}: its certificate is not valid yet: the clock of this "
                "computer is not set (see timedatectl); waits until it is",
                CLOCK_S,
            )
        case ssl.SSLCertVerificationError(verify_code=code) if code == _EXPIRED:
            return DestinationError(
                f"{where}: its certificate has expired, or the clock of this computer "
                "is wrong (see timedatectl)"
            )
        case ssl.SSLCertVerificationError():
            return DestinationError(
                f"{where}: its certificate is not trusted: {error.verify_message}; "
                "a certificate of your own goes into ca_file"
            )
        case ssl.SSLError():
            reason = (
                (getattr(error, "reason", None) or "no TLS").replace("_", " ").lower()
            )
            return DestinationError(
                f"{where}: no encrypted connection: {reason}; is this the port for TLS?"
            )
        case socket.gaierror():
            return DestinationError(f"{where}: no such name, or no network")
        case TimeoutError():
            return DestinationError(f"{where}: no answer within {CONNECT_S:.0f} s")
        case ConnectionRefusedError():
            return DestinationError(f"{where}: refused: nobody listens there")
        case _:
            reason = getattr(error, "strerror", None) or type(error).__name__
            return DestinationError(f"{where}: {reason}")
