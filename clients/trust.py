"""Whom clients take for a server: the certificates that they trust (TLS)."""

from __future__ import annotations

import ssl

__all__ = ["trust_certificate", "trust_file"]


def trust_file(ca_file: str) -> ssl.SSLContext | None:
    """The machine's authorities and those in a PEM file (the option --ca-file); None without a file: the machine's.

    OpenSSL finds the machine's, also by SSL_CERT_FILE. Raises ValueError for a file without certificates.
    """
    if not ca_file:
        return None
    context = ssl.create_default_context()
    try:
        context.load_verify_locations(ca_file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"--ca-file: {ca_file!r}: expected a PEM file with certificates ({reason})") from error
    return context


def trust_certificate(certfile: str) -> ssl.SSLContext:
    """The one certificate in a PEM file, whatever name it is for: that of a server in this process."""
    context = ssl.create_default_context(cafile=certfile)
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context
