"""Where along a tendon its compliance sits."""

from typing import TYPE_CHECKING, NamedTuple

from tenodesis import _core

if TYPE_CHECKING:
    from tenodesis.instrument.short_form import ShortForm


class ComplianceShares(NamedTuple):
    """Shares of a tendon's compliance by segment, from the spool."""

    handle: float
    handle_joint: float
    stem: float
    tip_joint: float
    anchor: float
    """Beyond a second vertex of the tip's joint; 0 for joints of one vertex."""


def compliance_shares(inst: "ShortForm") -> ComplianceShares:
    """Return how a tendon's compliance is shared among its segments: as given, or by length."""
    friction = inst.friction
    by_handle, by_tip = _core.joint_shares(inst.spec)
    by_length = inst.handle_length / (inst.tendon_length or inst.overall_length)
    handle = by_length if friction.handle_compliance_share is None else friction.handle_compliance_share
    handle_joint = by_handle if (given := friction.handle_joint_compliance_share) is None else given
    tip_joint = by_tip if (given := friction.tip_joint_compliance_share) is None else given
    anchor = 0.0
    if friction.vertices_per_joint > 1:
        anchor = tip_joint / 2 if (given := friction.anchor_compliance_share) is None else given
    return ComplianceShares(handle, handle_joint, 1 - handle - handle_joint - tip_joint - anchor, tip_joint, anchor)
