"""An authority and certificates for servers on this machine, made by the openssl command."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Certificates", "make_certificates"]

NAMES = "subjectAltName=DNS:localhost,IP:127.0.0.1,IP:::1,DNS:farside.test"


@dataclass(frozen=True)
class Certificates:
    """PEM files: an authority's certificate, and a server's certificate, its key, the same key with a password, and
    the key of another one; and certificate and key in one file."""

    authority: Path
    certificate: Path
    key: Path
    locked_key: Path
    other_key: Path
    both: Path


def make_certificates(folder: Path) -> Certificates:
    """Make them in a folder."""

    def path(name: str) -> Path:
        return folder / f"{name}.pem"

    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2")
    (folder / "names").write_text(f"{NAMES}\nkeyUsage=digitalSignature\nbasicConstraints=critical,CA:FALSE\n")
    _openssl(*new, "-x509", "-subj", "/CN=authority", "-addext", "keyUsage=critical,keyCertSign,cRLSign",
             "-keyout", path("authority_key"), "-out", path("authority"))  # fmt: skip
    _openssl(*new[:-2], "-subj", "/CN=farside", "-keyout", path("key"), "-out", path("request"))
    _openssl("x509", "-req", "-in", path("request"), "-CA", path("authority"), "-CAkey", path("authority_key"),
             "-CAcreateserial", "-days", "2", "-extfile", folder / "names", "-out", path("certificate"))  # fmt: skip
    _openssl("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-out", path("other_key"))
    _openssl("pkcs8", "-topk8", "-in", path("key"), "-passout", "pass:secret", "-out", path("locked_key"))
    path("both").write_text(path("key").read_text() + path("certificate").read_text())
    names = ("authority", "certificate", "key", "locked_key", "other_key", "both")
    return Certificates(*map(path, names))


def _openssl(*arguments: str | Path) -> None:
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
