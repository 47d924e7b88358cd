"""The independent checks of the report: SciPy's root finder and the same joint built in MuJoCo."""

import html
from collections.abc import Sequence

import numpy as np
from peers import kinematics_peers, mujoco_peer, scipy_peer
from scipy.spatial.transform import Rotation

from tenodesis import kinematics, statics
from tenodesis.errors import MissingExtraError
from tenodesis.instrument import ShortForm, TendonGear
from tenodesis.kinematics import Posture
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import CarePoint, Chart, Plot, ResultColumn, Section, fixed, named, number
from tenodesis.statics import chain

SCIPY_POINTS = 10_000
_TITLE = "Independent verification"
_ANGLES = 9  # handle angles, and
_FORCES = 9  # forces, of the grid that MuJoCo settles
_POSES = (-60.0, -40.0, 40.0, 60.0)  # output angles of each axis in the two-axis check, deg
_POSTURES = 20


def section(context: Context) -> Section:
    """Compare the statics with code that shares nothing with them."""
    inst = context.inst
    if not isinstance(inst, TendonGear):
        return Section(
            "verification",
            _TITLE,
            "<p>SciPy and MuJoCo check the tendon-gear joint; for the other mechanisms see the tests.</p>",
        )
    source = "the model's equations" if context.is_own else "the paper's equations as printed"
    text = f"<p>SciPy solves {source} with its own root finder."
    pair = (("instrument", inst), ("scale_model", context.scaled))
    instruments = {role: each for role, each in pair if isinstance(each, TendonGear)}
    table = context.table(
        "Largest difference of the output angle [°]; MuJoCo's load cases with an equilibrium, those with a slack "
        "tendon, and points on which this package and the other code disagree whether there is an equilibrium",
        "instrument",
        ResultColumn(
            f"SciPy, {SCIPY_POINTS} random points",
            "verification.scipy.{role}",
            "deg",
            "Largest difference from SciPy's root finder, {role}",
            form=number,
        ),
        ResultColumn(
            "disputed",
            "verification.scipy.{role}.disputed",
            "1",
            "Points on whose solvability SciPy disagrees, {role}",
            digits=0,
        ),
        ResultColumn(
            "MuJoCo, settled",
            "verification.mujoco.{role}",
            "deg",
            "Largest difference from the joint settled in MuJoCo, {role}",
            form=number,
            optional=True,
        ),
        *(
            ResultColumn(name, f"verification.mujoco.{{role}}.{name}", "1", about, digits=0, optional=True)
            for name, about in (
                ("cases", "Load cases with an equilibrium settled in MuJoCo, {role}"),
                ("slack", "Load cases settled in MuJoCo with a slack tendon, {role}"),
                ("disputed", "Cases on whose stability MuJoCo disagrees, {role}"),
            )
        ),
    )
    try:
        settled = {role: _mujoco(context, each) for role, each in instruments.items()}
        independence, plots = _axes(context, inst)
        care = _radial(context, inst)
        # What is checked is the tool, not the instrument.
        independence += "" if context.is_own else f"<p>{_frames(context)}</p>"
    except MissingExtraError as missing:
        settled, plots, care = {}, [], []
        independence = f"<p>The check against MuJoCo is left out: {html.escape(str(missing))}</p>"
    else:
        text += (
            " MuJoCo knows no equation: two bodies roll on each other by a joint equality, strings run through sites "
            "and only pull, and the tip is wherever the mechanism comes to rest."
        )
    for role, each in instruments.items():
        table.row(named(each), *_scipy(each), *settled.get(role, [np.nan] * 4), role=role)
    return Section("verification", _TITLE, f"{text}</p>{independence}", plots, [table], care)


def _heavy(inst: ShortForm) -> float:
    """Return a load well into slack, N; without pretension, a load that costs half a radian."""
    slack = 1.3 * float(statics.slack_force(inst, 0.0))
    return slack or float(0.5 / statics.loss_of_dexterity(inst, 0.0, 1.0))


def _scipy(inst: TendonGear) -> tuple[float, float]:
    """Return the largest difference, deg, and the number of points on whose solvability both disagree."""
    random = np.random.default_rng(1)
    end = statics.reach(inst)
    handle = random.uniform(-end, end, SCIPY_POINTS)
    force = random.uniform(-1, 1, SCIPY_POINTS) * _heavy(inst)
    ours = statics.output_angle(inst, handle, force)
    theirs = scipy_peer.output_angle(inst, handle, force)
    largest = np.degrees(np.fmax.reduce(np.abs(ours - theirs)))
    return float(largest), float(np.sum(np.isnan(ours) != np.isnan(theirs)))


def _mujoco(context: Context, inst: TendonGear) -> tuple[float, float, float, float]:
    """Return the largest difference, deg, the cases with an equilibrium, those with slack, and the disputed cases."""
    end = statics.reach(inst)
    limit = _heavy(inst)
    differences, slack, disputed = [0.0], 0, 0
    for handle in np.linspace(-end, end, _ANGLES):
        for force in np.linspace(-limit, limit, _FORCES):
            ours = statics.equilibrium(inst, handle, force)
            theirs = mujoco_peer.settle(inst, handle, force)
            disputed += np.isnan(ours.output_angle) != np.isnan(theirs.output_angle)
            if np.isfinite(ours.output_angle) and np.isfinite(theirs.output_angle):
                differences.append(abs(ours.output_angle - theirs.output_angle))
                slack += min(ours.agonist, ours.antagonist) == 0
            context.progress("MuJoCo")
    return float(np.degrees(max(differences))), len(differences) - 1, slack, disputed


def mujoco_cases(inst: ShortForm, scaled: ShortForm | None) -> int:
    """Return the number of progress reports of the section, for a progress bar."""
    if not isinstance(inst, TendonGear):
        return 0
    grids = sum(isinstance(each, TendonGear) for each in (inst, scaled))
    if len(inst.axes) < 2:
        return grids * _ANGLES * _FORCES
    poses, forces = len(_POSES), len(_axis_forces(inst))
    # Both axes together, and each alone, without load and with every load.
    return grids * _ANGLES * _FORCES + (poses**2 + 2 * poses) + ((poses * forces) ** 2 + 2 * poses * forces)


def _axes(context: Context, inst: TendonGear) -> tuple[str, list[Plot]]:
    """Compute how far an axis moves because the other axis is moved and loaded, and draw it."""
    if len(inst.axes) < 2:
        return "", []
    forces = _axis_forces(inst)
    share = min(1.0, float(np.degrees(inst.output_range)) / max(_POSES))
    poses = [share * pose for pose in _POSES]
    angles = [float(np.radians(pose)) for pose in poses]
    found = mujoco_peer.axis_independence(inst, angles, forces, lambda: context.progress("MuJoCo"))
    unloaded = context.add(
        "axes.unloaded_coupling",
        abs(np.degrees(found.unloaded.change)),
        "deg",
        "Largest change of an axis's angle by motion of the other axis, no load (MuJoCo)",
    )
    loaded = context.add(
        "axes.loaded_coupling",
        abs(np.degrees(found.loaded.change)),
        "deg",
        f"Largest change of an axis's angle by the other axis, {max(poses):.0f} deg, {max(forces):.3g} N (MuJoCo)",
    )
    difference = context.add(
        "axes.coupled_difference",
        _together_difference(inst, found),
        "deg",
        "Largest difference of the statics of both axes together from MuJoCo over all cases of this check",
    )
    worst = found.loaded
    chart, (axis,) = Chart.panels(height=3.4)
    pitch = chart.keep("pitch output angle, unloaded [deg]", np.linspace(0.0, max(poses), 7))
    handle = statics.handle_angle(inst, np.radians(pitch))
    yaw = float(statics.handle_angle(inst, np.radians(40.0 * share)))
    for force, color in zip((0.0, *forces), (style.INK, *style.LOADS), strict=False):
        settled = [mujoco_peer.settle_two_axis(inst, yaw, float(other), force, force).yaw for other in handle]
        change = np.degrees(np.array(settled) - settled[0])
        label = "no load" if force == 0 else f"{force:.2g} N on both axes"
        chart.curve(axis, pitch, f"change of yaw, {label} [deg]", change, "o-", ms=4, color=color, label=label)
    axis.set(xlabel="unloaded pitch output angle [deg]", ylabel="change of yaw angle [deg]")
    axis.legend(loc="upper left")
    whose = "The model" if context.is_own else "The paper"
    text = (
        f"<p><b>How independent are yaw and pitch?</b> {whose} superposes two planar joints. In MuJoCo, with the two "
        f"pairs stacked and both axes moved to ±{max(poses):.0f}°, moving one axis changes the other by "
        f"{number(unloaded, 2)}° without a load: the geometry is independent indeed. Under load it is not: up to "
        f"<b>{fixed(loaded, 1)}°</b> ({worst.axis}, at {np.degrees(worst.yaw):.0f}°/{np.degrees(worst.pitch):.0f}° and "
        f"{worst.force_yaw:.2g} N on both axes), because flexing pitch shortens the lever of the load on yaw, by cos "
        f"θ<sub>pitch</sub>, and turns part of the pitch load into a radial force on yaw. The statics of the "
        f"expanded instrument, which solve both joints at once under the same forces, explain all "
        f"of it: over the {len(found.cases)} cases their angles are within {number(difference, 2)}° of MuJoCo's.</p>"
    ).replace("-", "−")
    plot = chart.plot(
        "axis_independence",
        f"Change of the yaw angle, set to {40 * share:.0f}° without load, as pitch is flexed; {named(inst)}, MuJoCo.",
    )
    return text, [plot]


def _together_difference(inst: TendonGear, found: mujoco_peer.Independence) -> float:
    """Return the largest difference of the statics of both joints together from MuJoCo, deg."""
    poses = np.array(list(found.cases))
    settled = np.array([(case.yaw, case.pitch) for case in found.cases.values()])
    # A positive force is one against positive flexion; the check has the same joint on both axes.
    wrench = np.pad(-poses[:, 2:], ((0, 0), (0, 4)))
    handle = np.asarray(statics.handle_angle(inst, poses[:, :2]))
    angles = chain.output_angles(inst.replace(overrides=None), handle, wrench)
    return float(np.degrees(np.fmax.reduce(np.abs(angles - settled), axis=None)))


def _axis_forces(inst: ShortForm) -> Sequence[float]:
    """Return two loads well below the fold of a strongly flexed joint, N."""
    return (0.07 * _heavy(inst), 0.17 * _heavy(inst))


def _radial(context: Context, inst: TendonGear) -> list[CarePoint]:
    """Compare the radial term as printed and by virtual work with MuJoCo."""
    if context.is_own:
        return []
    force, radial = 0.07 * _heavy(inst), 3.3 * _heavy(inst)
    unloaded = min(70.0, 0.9 * float(np.degrees(inst.output_range)))
    handle = float(statics.handle_angle(inst, np.radians(unloaded)))
    settled = mujoco_peer.settle(inst, handle, force, radial)
    if np.isnan(settled.output_angle):
        return []
    half = settled.output_angle / 2
    coefficient = mujoco_peer.radial_coefficient(inst, settled, force, radial)
    ours = statics.output_angle(inst, np.array([handle]), force, radial_force=radial)[0]
    key = "care.9.radial"
    measured = context.add(f"{key}.mujoco", coefficient, "1", "Coefficient of the radial force in eq. 1, by MuJoCo")
    tangent = context.add(
        f"{key}.virtual_work", np.tan(half), "1", "Coefficient of the radial force by virtual work, tan θ_d"
    )
    sine = context.add(f"{key}.printed", np.sin(half), "1", "Coefficient of the radial force as printed, sin θ_d")
    difference = context.add(
        f"{key}.angle_difference",
        np.degrees(ours - settled.output_angle),
        "deg",
        "Output angle under a radial force, this package's minus MuJoCo's",
    )
    return [
        CarePoint(
            9,
            "The radial term of eq. 1 is a tangent, not a sine",
            "Both loads act about the contact point, the tendons with the arm r cos θ<sub>d</sub>; dividing by it "
            f"leaves F<sub>r</sub> tan θ<sub>d</sub>, where eq. 1 has F<sub>r</sub> sin θ<sub>d</sub>. At "
            f"{unloaded:.0f}° with {radial:.3g} N pulling outward, the tensions in MuJoCo give {fixed(measured, 4)}: "
            f"tan is {fixed(tangent, 4)}, sin is {fixed(sine, 4)}. This package uses the tangent "
            f"and differs from MuJoCo by {number(abs(difference), 2)}°.",
        )
    ]


def _frames(context: Context) -> str:
    """Return a sentence on how far the bodies are from MuJoCo's."""
    distance = _off_mujoco(context.inst)
    about = "Largest distance, or difference of an entry of a rotation matrix, from MuJoCo's pose of a body"
    context.add("workspace.mujoco", distance, "m", about)
    return (
        f"Positions of all bodies equal those of the exported model in MuJoCo to {number(distance, 1)} m, and the "
        "entries of their rotation matrices as closely."
    )


def _off_mujoco(inst: ShortForm) -> float:
    """Return how far the bodies are from MuJoCo's at random postures, m and as entries of rotation matrices."""
    random = np.random.default_rng(0)
    postures = []
    for _ in range(_POSTURES):
        drawn = {key: float(random.uniform(*ends)) for key, ends in kinematics.limits(inst)._asdict().items()}
        handle = {f"handle_{axis}": float(random.uniform(-1, 1)) * inst.axis(axis).handle_range for axis in inst.axes}
        postures.append(Posture(**drawn, **handle))
    joints = [kinematics.joint_positions(inst, posture, format="mjcf") for posture in postures]
    worst = 0.0
    for posture, theirs in zip(postures, kinematics_peers.mujoco_poses(kinematics.mjcf(inst), joints), strict=True):
        for name, frame in kinematics.frames(inst, posture).bodies.items():
            if name not in theirs:  # the chord of a backbone, which is a row of vertebrae there
                continue
            position, rotation = theirs[name]
            turned = Rotation.from_quat(frame.quaternion, scalar_first=True).as_matrix()
            worst = max(worst, float(np.abs(frame.position - position).max()))
            worst = max(worst, float(np.abs(turned - rotation).max()))
    return worst
