"""Claims about the instruments of joints and tendons that come with the package."""

import re
import tomllib
from importlib import resources

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import instrument, statics
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm
from tenodesis.run import Array
from tenodesis.statics import chain

from .chain_samples import LISTED
from .conftest import refused

WRENCH = [0.3, -0.2, 0.1, 0.0, 0.01, 0.0]


def text(name: str) -> str:
    return (resources.files("tenodesis") / "instruments" / f"{name}.toml").read_text("utf-8")


def keys(values: dict[str, object], prefix: str = "") -> set[str]:
    """Return the keys of a file that hold quantities, lists of tables without their places."""
    found = set()
    for key, value in values.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, dict):
                found |= keys(one, f"{prefix}{key}.")
            elif isinstance(one, str) and re.match(r"-?\d", one):
                found.add(prefix + key)
    return found


@pytest.mark.parametrize("name", LISTED)
def test_every_value_of_a_file_has_a_source(name: str) -> None:
    values = tomllib.loads(text(name))
    sources = values.pop("sources")
    assert text(name).startswith("# ") and instrument.expanded(name).name == name
    for key in keys(values):
        parts = key.split(".")
        assert any(".".join(parts[:n]) in sources for n in range(1, len(parts) + 1)) or "tendons.grip" in sources, key


@pytest.mark.parametrize("name", LISTED)
def test_a_file_at_rest_is_straight_and_moves_under_a_load(name: str) -> None:
    inst = instrument.expanded(name)
    assert chain.output_angles(inst, 0) == pytest.approx(0, abs=1e-12)
    assert np.abs(chain.output_angles(inst, 0, WRENCH)).max() > 1e-4


@pytest.mark.parametrize(("name", "planar"), [("hybrid-real-size", "real-size"), ("hybrid-scaled-up", "scaled-up")])
def test_the_hybrid_instrument_without_grip_is_the_planar_file_with_two_axes(name: str, planar: str) -> None:
    axes = instrument.expanded(tn.load(planar).replace(axes=("yaw", "pitch")))
    alone = chain.equilibrium(axes, [0.2, -0.1], WRENCH, axes="stem")
    found = chain.equilibrium(name, [0.2, -0.1, 0.1], WRENCH, axes="stem", grip_force=0.5)
    assert found.angles[:2] == pytest.approx(alone.angles, abs=1e-9)
    assert found.tensions[:4] == pytest.approx(alone.tensions, rel=1e-9)


def test_the_trigger_closes_the_hybrid_instruments_jaw_and_its_spring_opens_it() -> None:
    closed = chain.equilibrium("hybrid-real-size", [0, 0, 0.4])
    assert closed.angles[2] < -0.3 and closed.tensions[4] > 0
    opened = chain.equilibrium("hybrid-real-size", [0, 0, -0.4])
    assert opened.angles[2] == pytest.approx(0, abs=1e-9) and opened.tensions[4] == 0


# jhu-dvrk/sawIntuitiveResearchKit, share/tool/LARGE_NEEDLE_DRIVER_400006.json and MARYLAND_BIPOLAR_FORCEPS_420172.json:
# pitch, yaw and jaw by the turns of disks 2, 3 and 4, and how far the last row is from twice the one before.
DVRK: dict[str, tuple[list[list[float]], float]] = {
    "needle-driver": ([[1.0186, 0, 0], [-0.8306, 0.6089, 0.6089], [0, -1.2177, 1.2177]], 1.01e-4),
    "maryland-dissector": ([[1, 0, 0], [-0.630273, 0.457982, 0.457982], [0, -0.915964, 0.915964]], 1e-9),
}


def drawn(inst: FullForm) -> Array:
    """Return the lengths that the turns of disks 2, 3 and 4 draw: those of pitch, second and first jaw."""
    assert inst.spool_radius is not None
    names = [tendon.name for tendon in inst.tendons]
    lengths = np.zeros((len(names), 3))
    for disk, joint in enumerate(("pitch", "jaw_2", "jaw_1")):
        lengths[names.index(f"{joint}_wound"), disk] = inst.spool_radius
        lengths[names.index(f"{joint}_unwound"), disk] = -inst.spool_radius
    return lengths


@pytest.mark.parametrize("name", DVRK)
def test_turns_of_an_endowrists_motors_give_the_angles_of_the_open_tool_file(name: str) -> None:
    inst, (matrix, rounding) = instrument.expanded(name), DVRK[name]
    pitch, one, other = statics.coupling(inst) @ drawn(inst)
    found = np.array([pitch, (one + other) / 2, one - other])
    assert found[:2] == pytest.approx(np.array(matrix)[:2], abs=1e-9)
    assert found[2] == pytest.approx(matrix[2], abs=rounding)


@pytest.mark.parametrize("name", DVRK)
def test_an_object_between_the_jaws_presses_them_apart_evenly(name: str) -> None:
    pitch, one, other = chain.output_angles(name, 0, grip_force=2.0)
    assert one > 1e-3 and one == pytest.approx(-other, rel=1e-9) and pitch == pytest.approx(0, abs=1e-12)


def test_the_far_segments_tendons_bend_the_near_one_too() -> None:
    # Wound by one stroke, a rigid near segment would stay straight only if its own pair held it.
    inst = instrument.in_arcs("two-segment-continuum", 1)
    near, far = chain.output_angles(inst, 0, strokes=[0, 0, 1e-3, -1e-3])
    assert near > 0.01 and far > near
    arms = inst.tendon_arms("tip")
    assert np.abs(arms) == pytest.approx(1.8e-3 * np.array([[1, 0], [1, 0], [1, 1], [1, 1]]))


def test_what_takes_the_short_form_says_that_a_file_lists_joints_and_tendons() -> None:
    inst = tn.load("needle-driver")
    assert inst == instrument.expanded("needle-driver") and "needle-driver" in tn.shipped()
    with pytest.raises(InstrumentError, match="needle-driver lists joints and tendons; it must be a planar instrument"):
        print(inst.overall_length)
    with pytest.raises(InstrumentError, match="needle-driver lists joints and tendons; it must be a planar instrument"):
        tn.similarity.compare(inst, inst)


def _of_the_short_form_alone() -> list[str]:
    full = set(FullForm.model_fields) | set(dir(FullForm))
    kinds = tn.instrument.JOINT_TYPES.values()
    return sorted({name for kind in kinds for name in {*kind.model_fields, *dir(kind)} - full if name[0] != "_"})


@pytest.mark.parametrize("name", _of_the_short_form_alone())
def test_what_only_the_short_form_has_is_refused_in_one_sentence(name: str) -> None:
    with refused("joint_type", kind=InstrumentError, allowed="a planar instrument"):
        getattr(tn.load("needle-driver"), name)


def test_the_short_form_alone_has_axes_radii_and_what_follows_from_them() -> None:
    expected = {"joint_type", "axes", "planar", "spec", "handle_range", "tendon_stiffness", "rig_arm", "mismatch"}
    assert expected | {"distal_gear_radius", "distal_tendon_offset"} <= set(_of_the_short_form_alone())


def test_an_unknown_name_is_an_attribute_error() -> None:
    inst = tn.load("needle-driver")
    assert not hasattr(inst, "speed") and not hasattr(inst, "_axis")
    with pytest.raises(AttributeError):
        print(FullForm.__new__(FullForm).tip_joints)  # of an instrument that is not complete


def test_a_short_form_has_the_joints_and_tendons_that_it_stands_for(real: tn.Instrument) -> None:
    assert [joint.name for joint in real.tip_joints] == ["yaw", "pitch"]
    assert [tendon.name for tendon in real.tendons] == [
        *("yaw_agonist", "yaw_antagonist", "pitch_agonist", "pitch_antagonist")
    ]
    assert real.stiffnesses == pytest.approx([real.tendon_stiffness] * 4)
    softer = real.replace(pretension=20.0)
    assert softer.pretensions == pytest.approx([20.0] * 4)


def test_a_joint_that_no_force_reaches_must_be_a_jaw_of_known_length() -> None:
    values = tomllib.loads(text("hybrid-real-size"))
    del values["grip"]["length"]
    with refused("end_effector_length", kind=InstrumentError):
        instrument.expanded("hybrid-real-size").replace(grip=values["grip"])
