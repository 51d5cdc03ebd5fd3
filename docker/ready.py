"""The image's health check: exit status 0 when the server answers and all kernels that it needs are there."""

import http.client  # not urllib, which would ask the proxy that Docker may set in containers
import json
import os
import ssl
import sys


def is_ready(port: int, *, secure: bool) -> bool:
    """Whether the server on a port of this machine is ready; secure: it has a certificate."""
    if secure:
        trusting = ssl.create_default_context()  # it is ours, and its certificate is for its public name
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        connection: http.client.HTTPConnection = http.client.HTTPSConnection(
            "localhost", port, timeout=4, context=trusting
        )
    else:
        connection = http.client.HTTPConnection("localhost", port, timeout=4)
    try:
        connection.request("GET", "/status?seconds=1")
        kernels = json.load(connection.getresponse())["kernels"]
        return kernels is None or kernels["ready"] == kernels["of"]
    except (OSError, ValueError, KeyError, http.client.HTTPException):
        return False
    finally:
        connection.close()


if __name__ == "__main__":
    port, certificate = os.environ.get("FARSIDE_PORT"), os.environ.get("FARSIDE_SSL_CERTFILE")
    sys.exit(not is_ready(int(port or 8765), secure=bool(certificate)))
