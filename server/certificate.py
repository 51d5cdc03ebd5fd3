"""The certificate with which the server proves to clients who it is (TLS), checked before the server starts."""

from __future__ import annotations

import ssl

__all__ = ["check_certificate"]


class _PasswordError(Exception):
    """The key needs a password."""


def check_certificate(certfile: str, keyfile: str) -> None:
    """Check that a certificate can be served; both are names of PEM files, and without `keyfile` the key is in
    `certfile`. Nothing is checked if both are empty.

    Raises ValueError, with `ssl_certfile` or `ssl_keyfile` as the field, for a file that cannot be read or does not
    hold what it should, and for a key of another certificate or one that needs a password.
    """
    if not certfile:
        if keyfile:
            raise ValueError(f"ssl_keyfile: {keyfile!r}: expected only with a certificate (ssl_certfile)")
        return
    _read("ssl_certfile", certfile, "certificate")
    if keyfile:
        _read("ssl_keyfile", keyfile, "private key")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certfile, keyfile or None, _refuse)
    except _PasswordError:
        raise ValueError(f"ssl_keyfile: {keyfile or certfile!r}: expected a key without a password") from None
    except (ssl.SSLError, ValueError) as error:
        reason = str(getattr(error, "reason", None) or error).lower().replace("_", " ")
        expected = f"the private key of the certificate in {certfile!r} ({reason})"
        raise ValueError(f"ssl_keyfile: {keyfile or certfile!r}: expected {expected}") from error


def _read(field: str, name: str, content: str) -> None:
    """Check that a PEM file can be read and that its certificates are whole, or that it holds a private key."""
    try:
        with open(name, "rb") as file:
            text = file.read()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"{field}: {name!r}: expected a PEM file with a {content} ({reason})") from error
    if content == "certificate":
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_verify_locations(cadata=_certificates(text))
        except (ssl.SSLError, ValueError) as error:
            raise ValueError(f"{field}: {name!r}: expected a PEM file with a {content} ({error})") from error
    elif b"PRIVATE KEY-----" not in text:
        raise ValueError(f"{field}: {name!r}: expected a PEM file with a {content} (there is none)")


def _certificates(text: bytes) -> str:
    """The certificates in a PEM file, without keys and remarks; raises ValueError if there are none."""
    begin, end = "-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----"
    parts = text.decode("latin-1").split(begin)[1:]
    if not parts:
        raise ValueError("there is none")
    return "\n".join(begin + part.partition(end)[0] + end for part in parts)


def _refuse() -> str:
    raise _PasswordError
