"""Who a client is: the name of its key, or without one its address."""

import functools
import ipaddress

from fastapi import Request

NETWORK_BITS = 64  # of an IPv6 address: whoever has one such network has all addresses in it


def client_of(request: Request) -> str:
    """Return the name under which a request's client has its limits.

    What checks keys leaves their owner's name in `request.state.client`.
    """
    name: str | None = getattr(request.state, "client", None)
    if name is not None:
        return name
    return network_of(request.client.host if request.client else "")


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
