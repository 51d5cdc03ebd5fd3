"""The image's health check: exit status 0 when the server answers and all kernels that it needs are there."""

import http.client  # not urllib, which would ask the proxy that Docker may set in containers
import json
import os
import sys


def is_ready(port: int) -> bool:
    """Whether the server on a port of this machine is ready."""
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
    sys.exit(not is_ready(int(os.environ.get("FARSIDE_PORT") or 8765)))
