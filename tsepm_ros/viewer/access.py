"""Who may see the page: tokens, and names under which a browser may ask for it."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit


def is_loopback(address: str) -> bool:
    """Whether an IP address reaches this machine only."""
    try:
        return ipaddress.ip_address(address.partition("%")[0]).is_loopback
    except ValueError:
        return False


def token_for(addresses: Iterable[str], given: str) -> str:
    """Token that a server on some addresses demands; empty if it needs none.

    Parameters
    ----------
    addresses : iterable of str
        The addresses to which it is bound.
    given : str
        The token of the options; empty: a random token, unless all addresses are loopback ones.
    """
    if given or all(map(is_loopback, addresses)):
        return given
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class Access:
    """The checks of a request.

    Attributes
    ----------
    token : str
        Empty: none is demanded.
    names : frozenset of str
        Host names, in lower case, under which the page may be asked for, besides IP addresses.
        Another name may have been pointed here by its owner, whose page a browser would then take
        for the same site (DNS rebinding).
    """

    token: str
    names: frozenset[str]

    @classmethod
    def to(cls, host: str, token: str) -> Access:
        """Access to a server that was told to listen on `host`."""
        name = socket.gethostname().lower()
        own = {name, f"{name}.local", socket.getfqdn().lower()} if token else set()
        return cls(token, frozenset({"localhost", host.lower(), *own}))

    def allows_host(self, header: str) -> bool:
        """Whether a Host header names this server."""
        try:
            name = urlsplit(f"//{header}").hostname or ""
        except ValueError:
            return False
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return name in self.names
        # Without a token, only those on this machine can be meant.
        return bool(self.token) or address.is_loopback

    def allows_origin(self, origin: str | None, host: str) -> bool:
        """Whether a page from an Origin header's site may ask; programs send none."""
        if origin is None:
            return True
        try:
            return urlsplit(origin).netloc.lower() == host.lower()
        except ValueError:
            return False

    def allows_token(self, given: str) -> bool:
        """Whether a token is the one demanded, in a time that does not depend on where it differs.

        True if none is demanded.
        """
        return not self.token or hmac.compare_digest(given.encode(), self.token.encode())
