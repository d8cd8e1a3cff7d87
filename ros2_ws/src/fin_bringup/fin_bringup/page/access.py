"""Who may see the page and press its buttons: whoever is at this computer, or else whoever has the token.

A page of somebody else's, open in the same browser, can send requests too. It does not have the token's cookie, which
is sent to no foreign page's requests (SameSite=Strict), and its Origin is not this server.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from dataclasses import dataclass
from urllib.parse import urlsplit

_TOKEN_BYTES = 12


@dataclass(frozen=True)
class Access:
    """Who may.

    Attributes:
        token: What must be known; empty at this computer alone.
    """

    token: str = ""

    @classmethod
    def listening_at(cls, host: str) -> Access:
        """Return that of a server at this address: with a new token where others can reach it."""
        return cls("" if is_here(host) else secrets.token_urlsafe(_TOKEN_BYTES))

    def knows(self, given: str) -> bool:
        """Whether this is the token."""
        return not self.token or hmac.compare_digest(given.encode(), self.token.encode())

    def host_refusal(self, host: str) -> str:
        """Return why a request for this Host is refused, or an empty text.

        Without a token the name must mean this computer: another one may have been made to point here by its owner.
        """
        if self.token or is_here(host_name(host)):
            return ""
        return f"this page is asked for as {host!r}: open it as http://localhost"

    @staticmethod
    def origin_refusal(origin: str, host: str) -> str:
        """Return why a page from this Origin may not open a socket here, or an empty text."""
        parts = urlsplit(origin)
        if parts.scheme in {"http", "https"} and parts.netloc.lower() == host.lower() and host:
            return ""
        return f"a page of {origin or 'nowhere'} may not speak to {host}"


def host_name(host: str) -> str:
    """Return the name in a Host header, without its port."""
    return urlsplit(f"//{host}").hostname or ""


def is_here(host: str) -> bool:
    """Whether a host's name means this computer, and nobody else can reach it there."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
