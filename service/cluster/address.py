"""Which cluster is meant: tls://HOST:PORT, tcp://HOST:PORT on this machine, or the file that a scheduler writes."""

from __future__ import annotations

import ipaddress
import json
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from simcore.errors import Problem, ScenarioError

FILE = "file:"
TLS = "tls"  # folder of the certificates, beside a scheduler's file
KEY, CERTIFICATE = "key.pem", "certificate.pem"
FIELD = "--cluster"
_FORMS = "must be tls://HOST:PORT, tcp://HOST:PORT or file:SCHEDULER.json"


@dataclass(frozen=True)
class ClusterAddress:
    """What `--cluster` names. insecure: plain TCP to another machine is wanted. certificates: their folder, if it is
    named."""

    text: str
    insecure: bool = False
    certificates: Path | None = None

    def __post_init__(self) -> None:
        if self.text.startswith(FILE):
            if not self.text.removeprefix(FILE):
                raise _refusal(self.text, _FORMS)
            return
        self._check(self.text)

    @property
    def file(self) -> Path | None:
        """The file in which the scheduler writes its address."""
        return Path(self.text.removeprefix(FILE)).absolute() if self.text.startswith(FILE) else None

    def endpoint(self) -> str | None:
        """Where the scheduler is now; None while its file is not there. Raises ScenarioError."""
        if self.file is None:
            return self.text
        try:
            address = json.loads(self.file.read_bytes())["address"]
        except (FileNotFoundError, json.JSONDecodeError):  # not there yet, or not yet whole
            return None
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise _refusal(self.text, f"is no file of a scheduler: {error}") from None
        self._check(address)
        return str(address)

    def tls_folder(self) -> Path | None:
        """The folder with key and certificate, if there is one; else Dask's own configuration has them."""
        beside = None if self.file is None else self.file.with_name(TLS)
        return self.certificates or (beside if beside is not None and beside.is_dir() else None)

    def _check(self, address: str) -> None:
        try:
            parts = urlsplit(address)
            complete = parts.scheme in ("tls", "tcp") and parts.hostname and parts.port
        except ValueError:
            complete = None
        if not complete:
            raise _refusal(self.text, _FORMS)
        if parts.scheme == "tcp" and not self.insecure and not on_this_machine(parts.hostname or ""):
            reason = "whoever reaches its port can run code as you: use tls://, or say --insecure"
            raise _refusal(self.text, f"is plain TCP to another machine ({address}); {reason}")


def on_this_machine(host: str) -> bool:
    """Whether nobody else can reach the host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _refusal(text: str, message: str) -> ScenarioError:
    return ScenarioError([Problem(FIELD, text, message)])
