"""Guesses at a secret, slowed down by address."""

import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class _Record:
    wrong: int = 0
    locked_until: float = 0.0


class Lockout:
    """Counts wrong guesses by address, and locks an address out for longer and longer.

    Parameters
    ----------
    free
        Wrong guesses without a consequence.
    first, longest
        Time of the first lock-out and of the longest, s; it doubles with every wrong guess.
    most
        Addresses that are remembered; the one not heard of for longest is forgotten first.
    clock
        Gives the time, s.
    """

    def __init__(
        self,
        *,
        free: int = 5,
        first: float = 1.0,
        longest: float = 300.0,
        most: int = 4096,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._free, self._first, self._longest, self._most, self._clock = free, first, longest, most, clock
        self._records: OrderedDict[str, _Record] = OrderedDict()

    def remaining(self, address: str) -> float:
        """Return for how long an address is locked out, s; 0 if it is not."""
        record = self._records.get(_network(address))
        return 0.0 if record is None else max(0.0, record.locked_until - self._clock())

    def wrong(self, address: str) -> None:
        """Count a wrong guess."""
        network = _network(address)
        record = self._records.setdefault(network, _Record())
        self._records.move_to_end(network)
        record.wrong += 1
        if record.wrong > self._free:
            # Beyond that many doublings the time is the longest anyway.
            doublings = min(record.wrong - self._free - 1, 64)
            record.locked_until = self._clock() + min(self._longest, self._first * 2.0**doublings)
        while len(self._records) > self._most:
            self._records.popitem(last=False)

    def right(self, address: str) -> None:
        """Forget the wrong guesses of an address."""
        self._records.pop(_network(address), None)


def _network(address: str) -> str:
    """Return what counts as one address: of version 6 a whole network, whose addresses are its owner's to choose."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address):
        if parsed.ipv4_mapped is not None:
            return str(parsed.ipv4_mapped)
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)
