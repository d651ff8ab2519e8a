"""The name of a client: that of its key, or its address where there is none."""

import functools
import ipaddress
from collections.abc import Iterable

from fastapi import Request

from app.service.request_record import record_of

NETWORK_BITS = 64  # of an IPv6 address: whoever has one such network has all addresses in it


def client_of(request: Request) -> str:
    """Return the name under which a request's client has its limits."""
    return record_of(request).client


@functools.lru_cache(maxsize=4096)
def network_of(address: str) -> str:
    """Return an IPv4 address as it is, however it is written, and the /64 of an IPv6 address.

    Examples
    --------
    >>> network_of("::ffff:192.0.2.1"), network_of("2001:db8::5")
    ('192.0.2.1', '2001:db8::/64')
    """
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((int(found), NETWORK_BITS), strict=False))


def is_address(text: str) -> bool:
    """Tell whether a text is an IPv4 or IPv6 address.

    Examples
    --------
    >>> is_address("2001:db8::5"), is_address("localhost")
    (True, False)
    """
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


class NamedNetworks:
    """Addresses and networks that an operator has named.

    Examples
    --------
    >>> "10.1.2.3" in NamedNetworks(["10.0.0.0/8"]), "::ffff:10.1.2.3" in NamedNetworks(["10.0.0.0/8"])
    (True, True)
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._networks = [ipaddress.ip_network(name, strict=False) for name in names]

    def __contains__(self, address: str) -> bool:
        try:
            found = ipaddress.ip_address(address)
        except ValueError:
            return False
        if isinstance(found, ipaddress.IPv6Address) and found.ipv4_mapped:
            found = found.ipv4_mapped
        return any(found in network for network in self._networks)
