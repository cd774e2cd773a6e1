"""Who may ask the server: this machine alone, or whoever has the token."""

import ipaddress
import os
import re
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from hmac import compare_digest
from urllib.parse import urlsplit

from morphosim import _validate

HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]*)(:(?P<port>[0-9]{0,5}))?")
"""A Host header: a name, or an address (in brackets if it has colons), and perhaps a port."""
LAST_PORT, LONGEST_NAME, LONGEST_PATH = 65535, 255, 4000
"""Largest port, and bytes of a file's name and of a path."""
PARAMETER = "token"
"""Name of the token in an address."""


def is_loopback(host: str) -> bool:
    """Whether a host name means this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def listening_host(host: str, port: int) -> str:
    """Host to listen at, an address in its usual form.

    Raises
    ------
    ValueError
        It is no name or address, or there is no such port.
    OSError
        Nobody knows the name, or it cannot be listened to there now.
    """
    _validate.integer("port", port, least=0, most=LAST_PORT)
    name = host.strip()
    name = name[1:-1] if name.startswith("[") and name.endswith("]") else name
    if not name:
        message = (
            f"host = {host!r} is no name or address; take 127.0.0.1 for this machine alone, or "
            "0.0.0.0 for whoever reaches it and has the token"
        )
        raise ValueError(message)
    try:
        found = socket.getaddrinfo(name, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = found[0]
        with socket.socket(family, kind, protocol) as trial:
            if os.name == "posix":  # as the server does: not in use, or left a moment ago
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(address)
    except (OSError, UnicodeError) as error:
        cause = getattr(error, "strerror", None) or error
        message = f"cannot listen at host {name!r}, port {port}: {cause}. Take another --host or "
        raise OSError(message + "--port (0 takes a free one)") from error
    return str(address[0]) if _is_address(name) else name


def _is_address(name: str) -> bool:
    """Whether a host is an address in figures, such as 127.0.0.1, ::1 or 0."""
    try:
        socket.getaddrinfo(name, None, flags=socket.AI_NUMERICHOST)
    except OSError:
        return False
    return True


def malformed(headers: Mapping[str, str], path: str) -> str:
    """What of a request nobody can understand; "" if there is nothing.

    Parameters
    ----------
    headers : with Host, and perhaps Origin
    path : with what was written in per cent put in
    """
    host = HOST.fullmatch(headers.get("Host", ""))
    if host is None or int(host["port"] or 0) > LAST_PORT:
        return f"Host {headers.get('Host')!r} is not a host and a port"
    try:
        _ = urlsplit(headers.get("Origin", "")).port
    except ValueError:
        return f"Origin {headers['Origin']!r} is not a site"
    parts = [part.encode(errors="replace") for part in path.split("/")]
    if "\0" in path or len(b"/".join(parts)) > LONGEST_PATH or max(map(len, parts)) > LONGEST_NAME:
        return "the path is too long, or has a NUL"
    return ""


@dataclass(frozen=True, slots=True)
class Access:
    """The rule that every request is held to, that of the websocket too.

    Attributes
    ----------
    token : str
        "" where the server listens to this machine alone: then none is asked for.
    """

    token: str = ""

    @classmethod
    def of_host(cls, host: str, always: bool = False) -> "Access":
        """Rule for a server that listens at `host`: a new token, unless that is loopback.

        `always` asks for one there too, which other users of this machine do not have.
        """
        return cls(secrets.token_urlsafe(24) if always or not is_loopback(host) else "")

    def refusal(
        self, headers: Mapping[str, str], parameters: Mapping[str, str], cookie: str | None
    ) -> str:
        """Why a request is refused; "" if it is not.

        Another site's page that sends the browser here has that site's Origin, or says that it is
        another site's where it shows something of us; one that has pointed its own name at this
        machine has that name as Host. All are refused; links to the page are not.

        Parameters
        ----------
        headers : with Host, and Origin, Sec-Fetch-Site and Sec-Fetch-Dest as browsers send them
        parameters : of the address, perhaps with the token
        cookie : the token as the browser has kept it
        """
        asked = headers.get("Host", "")
        if not self.token and not is_loopback(_name(asked)):
            return f"Host {asked!r} is not this machine; use 127.0.0.1 or localhost"
        origin = headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != asked:
            return f"Origin {origin!r} is another site; open the application itself"
        document = headers.get("Sec-Fetch-Dest") == "document"
        if headers.get("Sec-Fetch-Site") == "cross-site" and not document:
            return "another site shows this; open the application itself"
        if self.token and not self._known(parameters.get(PARAMETER), cookie):
            return "the token is missing or wrong; open the address that the terminal shows"
        return ""

    def _known(self, *given: str | None) -> bool:
        return any(
            compare_digest(text.encode(), self.token.encode()) for text in given if text is not None
        )


def _name(host: str) -> str:
    """Host without its port; "" if there is none."""
    found = HOST.fullmatch(host)
    return "" if found is None else found["name"].strip("[]")
