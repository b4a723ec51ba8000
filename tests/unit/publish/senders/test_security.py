"""Credentials from files that nobody else may read; faults that say what to do."""

import socket
import ssl
from pathlib import Path

import pytest

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.publish.senders import security
from imu_tracker.publish.senders.security import (
    CLOCK_S,
    Credentials,
    authorization,
    explain,
    read_credentials,
    tls_context,
)
from imu_tracker.publish.senders.sender import DestinationError


def written(path: Path, text: str, mode: int = 0o600) -> Path:
    path.write_text(text)
    path.chmod(mode)
    return path


def refused(path: Path) -> str:
    with pytest.raises(DestinationError) as caught:
        read_credentials(path)
    return str(caught.value)


def test_nothing_is_read_where_nothing_is_named() -> None:
    assert read_credentials(None) == Credentials()


@pytest.mark.parametrize("mode", [0o600, 0o400, 0o640, 0o440])
def test_a_file_for_owner_and_group_is_read(tmp_path: Path, mode: int) -> None:
    path = written(tmp_path / "c", 'user = "car"\npassword = "x y"\n', mode)
    assert read_credentials(path) == Credentials("car", "x y")


@pytest.mark.parametrize("mode", [0o644, 0o604, 0o660, 0o602, 0o601])
def test_a_file_that_others_may_read_or_change_is_refused(
    tmp_path: Path, mode: int
) -> None:
    path = written(tmp_path / "c", 'token = "hunter2"\n', mode)
    assert f"chmod 640 {path}" in refused(path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "hunter2",
        'token = "hunter2',
        'token = "hunter2"\nsecret = "hunter2"\n',
        'token = ""\n',
        "token = 17\n",
        'token = "hunter2\\nX-Evil: yes"\n',
        'token = "hunt\u00e9r2"\n',
        'password = ["hunter2"]\n',
        "\udcff",
    ],
)
def test_what_is_no_credentials_is_refused_and_not_repeated(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "c"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    path.chmod(0o600)
    said = refused(path)
    assert "must hold lines like" in said
    assert "hunt" not in said


def test_a_bare_name_is_a_credential_of_systemd_or_the_file_it_is_taken_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, etc = tmp_path / "run", tmp_path / "etc"
    run.mkdir()
    etc.mkdir()
    written(run / "home", 'token = "of systemd"\n', 0o440)
    written(etc / "home.credentials", 'token = "of etc"\n')
    monkeypatch.setattr(security, "ETC", etc)
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    assert read_credentials(Path("home")).token == "of etc"
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(run))
    assert read_credentials(Path("home")).token == "of systemd"


def test_credentials_do_not_show_themselves() -> None:
    assert "hunter2" not in repr(Credentials("car", "hunter2", "hunter2"))
    assert "hunter2" not in f"{Credentials('car', 'hunter2')}"


def test_they_become_a_header() -> None:
    assert authorization(Credentials(), "Token") == {}
    token = authorization(Credentials(token="t"), "Token")
    assert token == {"Authorization": "Token t"}
    # RFC 7617, section 2: the example of its authors.
    basic = authorization(Credentials("Aladdin", "open sesame"), "Token")
    assert basic == {"Authorization": "Basic QWxhZGRpbjpvcGVuIHNlc2FtZQ=="}


def certificate_error(code: int, message: str) -> ssl.SSLCertVerificationError:
    error = ssl.SSLCertVerificationError(1, "certificate verify failed")
    error.verify_code, error.verify_message = code, message
    return error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (certificate_error(9, "not yet valid"), "clock of this computer is not set"),
        (certificate_error(10, "expired"), "has expired, or the clock"),
        (certificate_error(18, "self-signed"), "not trusted: self-signed"),
        (ssl.SSLError(1, "[SSL: WRONG_VERSION_NUMBER]"), "is this the port for TLS?"),
        (socket.gaierror(-2, "Name or service not known"), "no such name, or no netw"),
        (TimeoutError(), "no answer within"),
        (ConnectionRefusedError(111, "Connection refused"), "nobody listens there"),
        (OSError(101, "Network is unreachable"), "Network is unreachable"),
    ],
)
def test_a_fault_says_what_it_means(error: Exception, words: str) -> None:
    said = explain(error, "broker:8883")
    assert str(said).startswith("broker:8883: ")
    assert words in str(said)


def test_a_clock_that_is_not_set_is_waited_for_and_not_forgotten() -> None:
    assert explain(certificate_error(9, ""), "h").again_s == CLOCK_S
    assert explain(TimeoutError(), "h").again_s is None


def test_certificates_are_verified_and_their_names_too(tmp_path: Path) -> None:
    config = PublishConfig(name="a", kind="mqtt", url="mqtts://h")
    context = tls_context(config)
    assert context.verify_mode == ssl.CERT_REQUIRED
    assert context.check_hostname
    for key in ("ca_file", "cert_file"):
        broken = config.model_copy(update={key: written(tmp_path / key, "x")})
        with pytest.raises(DestinationError, match="no certificate"):
            tls_context(broken)
        missing = config.model_copy(update={key: tmp_path / "none"})
        with pytest.raises(DestinationError, match="No such file"):
            tls_context(missing)
