"""The independent check of the statics: the instrument built in MuJoCo, settled under the chapters' loads."""

import html

import numpy as np
from peers.chain_peer import ChainPeer

from tenodesis.errors import MissingExtraError
from tenodesis.paper.context import Context
from tenodesis.report.content import ResultColumn, Section
from tenodesis.statics import chain

_TITLE = "Independent verification"


def section(context: Context) -> Section:
    """Compare all angles with those at which MuJoCo's model of the instrument comes to rest."""
    inst = context.whole
    try:
        peer = ChainPeer(inst)
    except MissingExtraError as missing:
        return Section("verification", _TITLE, f"<p>Left out: {html.escape(str(missing))}</p>")
    about = "Largest difference of a joint's angle from MuJoCo, {state}, {words}"
    table = context.table(
        "Largest difference of a joint's angle from the same instrument in MuJoCo; a dash: it does not come to rest",
        "state",
        "load",
        ResultColumn("difference [°]", "verification.mujoco.{state}.{load}", "deg", about, digits=4, optional=True),
    )
    for state in context.subject.states:
        for load in context.subject.loads:
            row = load.wrench[np.newaxis]
            ours = chain.output_angles(inst, state.handle, row, grip_force=load.grip, strokes=state.strokes)[0]
            theirs = peer.settle(state.handle, load.wrench, grip_force=load.grip, strokes=state.strokes)
            apart = float(np.degrees(np.abs(ours - theirs.angles).max()))
            table.row(state.name, load.text, apart, state=state.name, load=load.name, words=load.text)
    text = (
        "<p>MuJoCo has the instrument as bodies, hinges and strings that never push, without friction, and shares no "
        "code with the statics: its angles are wherever the mechanism comes to rest.</p>"
    )
    return Section("verification", _TITLE, text, (), [table])
