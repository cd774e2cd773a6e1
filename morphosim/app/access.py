"""Who may ask the server: this machine alone, or whoever has the token."""

import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from hmac import compare_digest
from urllib.parse import urlsplit

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
    """Host without its port."""
    return urlsplit(f"//{host}").hostname or ""
