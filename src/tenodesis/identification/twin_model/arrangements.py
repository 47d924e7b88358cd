"""The arrangements of contacts along a tendon that recordings may ask for."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

from tenodesis.instrument import Instrument

_FIRST_BASE_WRAP = 0.1
"""rad, at which the search for a base wrap begins."""
_COMPLIANCE = "handle_length_share"


class Arrangement(NamedTuple):
    """An arrangement: its name, what it changes in an instrument file, and what is fitted in addition."""

    name: str
    changes: Mapping[str, Any]
    unknowns: tuple[str, ...] = ()

    def of(self, inst: Instrument) -> Instrument:
        """Return an instrument in this arrangement."""
        return inst.replace(**self.changes)


def arrangements(inst: Instrument, fitted: Sequence[str]) -> list[Arrangement]:
    """Return the arrangements to compare, that of the instrument first.

    They are joints of one vertex and of two, without and with a base wrap, and with the compliance where it is and
    free; parameters that are `fitted` are so in all of them.
    """
    own = inst.friction
    wrapped = own.base_wrap > 0
    free_share = _COMPLIANCE in fitted
    found = []
    for vertices, wrap, share in product((1, 2), (False, True), (False, True)):
        if share and free_share:
            continue
        words = ["one vertex a joint" if vertices == 1 else "two vertices a joint"]
        words += ["base wrap"] * wrap + ["free compliance"] * share
        changes: dict[str, Any] = {}
        if vertices != own.vertices_per_joint:
            changes["friction.vertices_per_joint"] = vertices
            if own.anchor_compliance_share is not None:
                changes["friction.anchor_compliance_share"] = None
        if wrap != wrapped:
            changes["friction.base_wrap"] = _FIRST_BASE_WRAP if wrap else None
        unknowns = ("friction.base_wrap",) * (wrap and not wrapped) + (_COMPLIANCE,) * share
        found.append(Arrangement(", ".join(words), changes, unknowns))
    return sorted(found, key=lambda one: bool(one.changes or one.unknowns))
