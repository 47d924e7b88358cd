"""Instruments as built: two vertices a joint, base wrap, compliance by segment, power of the tension, stiff tendons."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import plant
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.run import Run
from tenodesis.scaling.transfer import carry_friction
from tenodesis.similarity.groups import groups_of
from tenodesis.twin import TIME_STEP, Twin

from .conftest import refused
from .similar import geometrically_scaled
from .twin_motions import AS_BUILT, SHARES, clock, handle, same, slack_force, with_friction


def motion(inst: Instrument) -> dict[str, Any]:
    t = np.linspace(0, 1, 8000)
    return {
        "handle_angle": 0.9 * handle(inst, inst.output_range) * np.sin(9 * t),
        "force": -1.2 * slack_force(inst) * np.cos(9 * t + 1.2) * np.minimum(1, 20 * t),
        "spool_velocity": 0.4 * np.stack([np.sin(40 * t), -np.cos(33 * t)], -1),
    }


def pulled(inst: Instrument, at: float = 0.5, time_step: float = TIME_STEP, seconds: float = 1.2) -> Run:
    """Both tendons are wound up at a bent handle, until every contact of the agonist slides."""
    twin = Twin(inst, time_step=time_step, quasi_static=True)
    t = clock(seconds, time_step)
    twin.run(handle(inst, at) * np.minimum(1, 2 * t))
    speed = inst.pretension / inst.tendon_stiffness / inst.drives.spool_radius / seconds
    return twin.run(np.full(t.size, handle(inst, at)), spool_velocity=np.full((t.size, 2), speed))


# Statics


@pytest.mark.parametrize("kind", AS_BUILT)
def test_the_tension_where_the_joint_draws_holds_the_load_by_virtual_work(scaled: Instrument, kind: str) -> None:
    inst = with_friction(scaled, kind)
    t = clock(1.0)
    force = 0.5 * slack_force(inst) * np.sin(7 * t)
    run = Twin(inst, quasi_static=True).run(0.3 * np.sin(9 * t), force)
    values = plant.parameters(inst)
    radius, length = values["distal_radius"], values["end_effector_length"]
    arm = radius * np.cos(run.output_angle / 2)
    moment = (run.distal_tension[:, 0] - run.distal_tension[:, 1]) * arm
    assert moment == pytest.approx(force * (length + arm), abs=1e-9)


def test_keys_at_their_defaults_change_no_bit(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    stated = with_friction(any_inst, vertices_per_joint=1, base_wrap=0.0, load_index=1.0, tendon_bending_stiffness=0.0)
    command = motion(inst)
    same(Twin(inst).run(**command), Twin(stated).run(**command))


def test_shares_of_the_compliance_are_those_of_the_file_and_the_stem_has_the_rest(scaled: Instrument) -> None:
    inst = with_friction(scaled, "shares")
    shares = compliance_shares(inst)
    assert shares._asdict() == pytest.approx(SHARES | {"stem": 1 - sum(SHARES.values())})
    by_length = compliance_shares(with_friction(scaled, vertices_per_joint=2))
    assert by_length.anchor == by_length.tip_joint / 2


# Friction


@pytest.mark.parametrize("vertices", [1, 2])
@pytest.mark.parametrize("base", [0.0, 0.3])
def test_a_tendon_pulled_through_slides_by_all_wraps_before_the_tips_span(
    scaled: Instrument, vertices: int, base: float
) -> None:
    inst = with_friction(scaled, vertices_per_joint=vertices, base_wrap=base)
    run = pulled(inst)
    wraps = 2 * base + np.abs(run.handle_angle[-1]) + np.abs(run.output_angle[-1])
    if vertices == 2:
        # the last vertex is beyond
        wraps -= (base + np.abs(run.output_angle[-1])) / 2
    exponent = 0.15 * 1.0 + 0.3 * wraps
    assert run.tension[-1, 0] / run.distal_tension[-1, 0] == pytest.approx(np.exp(exponent), rel=1e-6)


def test_a_power_of_one_is_capstan_friction(scaled: Instrument) -> None:
    command = motion(scaled)
    for vertices in (1, 2):
        inst = with_friction(scaled, vertices_per_joint=vertices)
        power = inst.replace(**{"friction.law": "capstan-power", "friction.vertex_radius": 3e-4})
        one, other = (Twin(each).run(**command) for each in (inst, power))
        assert one.output_angle == pytest.approx(other.output_angle, abs=1e-9)


def passed_on(tension: float, exponents: list[float], index: float) -> float:
    """The closed form of the tension behind contacts in a row, with coefficients at 1 N."""
    return float((tension ** (1 - index) - (1 - index) * sum(exponents)) ** (1 / (1 - index)))


def test_friction_by_a_power_of_the_tension_ends_at_its_closed_form_with_the_second_order_of_the_step(
    scaled: Instrument,
) -> None:
    index, radius = 0.6, 4e-3
    inst = with_friction(
        scaled, law="capstan", vertices_per_joint=2, vertex_coefficient=0.3, sheath_coefficient=0.2
    ).replace(**{"friction.law": "capstan-power", "friction.load_index": index, "friction.vertex_radius": radius})
    off = []
    for steps in (20, 40, 80):
        run = pulled(inst, time_step=1.2 / steps)
        rounder = (radius / 1e-3) ** (1 - index)
        at_joints = np.abs(run.handle_angle[-1]) + np.abs(run.output_angle[-1]) / 2
        expected = passed_on(run.tension[-1, 0], [0.2, 0.3 * rounder * at_joints], index)
        off.append(abs(run.distal_tension[-1, 0] / expected - 1))
    assert off[0] < 1e-3
    assert off[0] > 3 * off[1] > 9 * off[2]


def test_bending_a_tendon_that_lies_on_its_vertices_costs_its_bending_energy_at_each(scaled: Instrument) -> None:
    stiffness, radius = 1e-7, 1e-3
    inst = with_friction(scaled, vertex_coefficient=0.0, sheath_coefficient=0.0, vertices_per_joint=2).replace(
        **{"friction.vertex_radius": radius, "friction.tendon_bending_stiffness": stiffness}
    )
    run = pulled(inst, at=1.0)
    loss = stiffness / (2 * radius**2)
    assert run.tension[-1, 0] - run.distal_tension[-1, 0] == pytest.approx(3 * loss, rel=1e-6)


def test_a_stiff_tendon_that_spans_a_slight_bend_costs_less_than_one_that_lies_on_the_vertex(
    scaled: Instrument,
) -> None:
    inst = with_friction(scaled, vertex_coefficient=0.0, sheath_coefficient=0.0).replace(
        **{"friction.vertex_radius": 1e-3, "friction.tendon_bending_stiffness": 1e-4}
    )
    run = pulled(inst, at=0.4)
    wraps = np.abs([run.handle_angle[-1], run.output_angle[-1]])
    ratio = run.tension[-1, 0] / run.distal_tension[-1, 0]
    assert ratio == pytest.approx(np.prod(2 - np.cos(wraps / 2)), rel=1e-6)
    assert run.tension[-1, 0] - run.distal_tension[-1, 0] < 1e-4 / (2 * 1e-6)


def test_runs_of_a_batch_vary_in_base_wrap_but_not_in_vertices(scaled: Instrument) -> None:
    inst = with_friction(scaled, vertices_per_joint=2)
    t = clock(0.5)
    batch = tn.twin.run_many(inst, 0.3 * np.sin(9 * t), vary={"friction.base_wrap": [0.0, 0.3]})
    alone = Twin(inst.replace(**{"friction.base_wrap": 0.3}), seed=1).run(0.3 * np.sin(9 * t))
    assert np.array_equal(batch["output_angle"][1], alone.output_angle)
    with refused("inst"):
        tn.twin.run_many(inst, 0.3 * np.sin(9 * t), vary={"friction.vertices_per_joint": [1, 2]})


# Similarity


def test_an_instrument_as_built_has_the_groups_of_its_geometric_copy(real: Instrument) -> None:
    inst = with_friction(real, "power", base_wrap=0.1, tendon_bending_stiffness=1e-7, vertices_per_joint=2)
    larger = geometrically_scaled(inst, 3.75)
    ours, theirs = groups_of(inst), groups_of(larger)
    assert {"n_v", "phi_0", "n", "T_r/(kr)", "r_v/r_r", "B/(2 r_v^2 k r)", "anchor share"} <= ours.keys()
    for name in ("n_v", "phi_0", "n", "T_r/(kr)", "r_v/r_r", "B/(2 r_v^2 k r)", "anchor share", "stem share"):
        assert theirs[name] == pytest.approx(ours[name], rel=1e-9), name
    comparison = tn.similarity.compare(inst, larger)
    assert comparison.error_at_rest(forces=[0.0, 0.3]).largest < 1e-3


def test_a_carried_arrangement_has_the_same_groups_where_they_do_not_depend_on_the_rope(
    real: Instrument, scaled: Instrument
) -> None:
    inst = with_friction(scaled, "power", base_wrap=0.1, tendon_bending_stiffness=1e-6, vertices_per_joint=2)
    carried = carry_friction(inst, real)
    assert carried.friction.vertices_per_joint == 2
    ours, theirs = groups_of(carried), groups_of(inst)
    for name in ("n_v", "phi_0", "n", "T_r/(kr)", "r_v/r_r", "B/(2 r_v^2 k r)"):
        assert ours[name] == pytest.approx(theirs[name], rel=1e-9), name


# Bad input


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"vertices_per_joint": 3}, r"friction\.vertices_per_joint = 3: .*less than or equal to 2"),
        ({"vertices_per_joint": 0}, r"friction\.vertices_per_joint = 0: .*greater than or equal to 1"),
        ({"base_wrap": -0.1}, r"friction\.base_wrap = -0\.1: it must be"),
        ({"vertex_radius": -1e-3}, r"friction\.vertex_radius = -0\.001: it must be"),
        ({"tendon_bending_stiffness": -1e-6}, r"friction\.tendon_bending_stiffness = -1e-06: it must be"),
        ({"tendon_bending_stiffness": 1e-6}, r"tendon_bending_stiffness is 1e-06 N\*m\^2, which needs a vertex_radius"),
        ({"load_index": 0.8}, r'load_index is 0\.8, which only law "capstan-power" has'),
        ({"anchor_compliance_share": 0.1}, r"anchor_compliance_share is 0\.1, which only joints of two vertices have"),
        (
            {"handle_compliance_share": 0.6, "tip_joint_compliance_share": 0.5},
            r"handle_compliance_share and tip_joint_compliance_share make 1\.1 of the tendon's compliance",
        ),
        ({"base_wrap": 3.0, "vertex_coefficient": 3.0}, "vertex_coefficient is 3, which .* friction exponent of 18"),
    ],
)
def test_what_cannot_be_built_is_refused_in_a_sentence(
    scaled: Instrument, changes: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InstrumentError, match=sentence) as refused:
        with_friction(scaled, **changes)
    assert "\n" not in str(refused.value)


def test_a_stiff_tendon_is_not_taken_with_the_stribeck_law(scaled: Instrument) -> None:
    with refused("friction", kind=InstrumentError):
        with_friction(scaled, "stribeck", vertex_radius=1e-3, tendon_bending_stiffness=1e-6)


def test_shares_that_leave_no_compliance_to_the_stem_are_refused(scaled: Instrument) -> None:
    inst = with_friction(scaled, handle_compliance_share=0.9, tip_joint_compliance_share=0.09)
    with refused("friction.handle_compliance_share", 0.9):
        Twin(inst)
