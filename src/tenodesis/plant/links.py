"""Links of the joints at the tip: masses, dampers and stops in the core's order, and their natural frequencies."""

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis.instrument import FullForm
from tenodesis.plant.axis import STOP_STIFFNESS_RATIO
from tenodesis.statics import straight_arms

Array = NDArray[np.float64]


def link_rows(inst: FullForm) -> Array:
    """Return mass, its centre, inertia about x, y, z, damping, stops, their stiffness, reach of the tip's joints."""
    stiffness = np.diag(stiffness_matrix(inst)).copy()
    for i, tie in enumerate(inst.ties):
        # What ties joints does not damp or stop them.
        if tie.is_rigid:
            stiffness[[i, tie.to]] -= tie.stiffness * np.array([1.0, tie.ratio**2])
    rods = _links(inst, 1.0)
    lowest = _frequencies(inst, rods)[0]
    density = (lowest / (2 * pi * inst.dynamics.natural_frequency)) ** 2
    links = _links(inst, density)
    inertia, _ = mass_matrix(inst, links, np.zeros(len(inst.tip_joints)))
    rows = np.zeros((len(inst.tip_joints), 10))
    rows[:, :5] = links
    for i in reversed(range(len(inst.tip_joints))):
        beyond = [
            other.offset + other.chord + rows[j, 9]
            for j, (other, on) in enumerate(zip(inst.tip_joints, inst.parents, strict=True))
            if on == i
        ]
        rows[i, 9] = max([inst.tip_joints[i].end_effector_length or 0.0, *beyond])
    for i, joint in enumerate(inst.tip_joints):
        critical = 2 * sqrt(stiffness[i] * inertia[i, i])
        damping = inst.dynamics.damping_ratio * critical if joint.damping is None else joint.damping
        rows[i, 5:9] = damping, *joint.stops, STOP_STIFFNESS_RATIO * stiffness[i]
    return rows


def _links(inst: FullForm, density: float) -> Array:
    """Return mass, its centre and inertias of links; what is not given is that of a rod of a density, kg/m."""
    joints = inst.tip_joints
    around = {joint.within for joint in joints}
    rows = np.zeros((len(joints), 5))
    for i, joint in enumerate(joints):
        if joint.name in around:
            continue  # nothing is between it and the joint within it
        beyond = [other.offset + other.chord for other, on in zip(joints, inst.parents, strict=True) if on == i]
        grip = inst.grip.length if inst.grip is not None and i in inst.jaws else None
        length = joint.end_effector_length or max([*beyond, grip or 0.0, joint.radius])
        only_inertia = joint.inertia is not None and joint.mass is None
        mass = (0.0 if only_inertia else density * length) if joint.mass is None else joint.mass
        centre = length / 2 if joint.centre_of_mass is None else joint.centre_of_mass
        across = mass * (centre**2 + length**2 / 12) if joint.inertia is None else joint.inertia
        rows[i] = mass, centre, across, across, mass * joint.radius**2 / 2
    return rows


def stiffness_matrix(inst: FullForm) -> Array:
    """Return the stiffness of the straight, unloaded wrist with all tendons taut, (joints, joints), N m/rad."""
    arms = straight_arms(inst)
    return np.asarray(arms.T @ (inst.stiffnesses[:, np.newaxis] * arms) + inst.springs)


def natural_frequencies(inst: FullForm) -> Array:
    """Return the angular natural frequencies of the straight, unloaded, frictionless wrist, rising, rad/s.

    The arcs of a backbone bend alike, and joints that are tied turn with the others: how these swing against each other
    needs no small time steps, since the twin's trapezoidal rule is stable for any.
    """
    alike = np.array([inst.bent(unit) for unit in np.eye(len(inst.bends))]).T
    return _frequencies(inst, link_rows(inst)[:, :5], alike)


def _frequencies(inst: FullForm, links: Array, motions: Array | None = None) -> Array:
    inertia, _ = mass_matrix(inst, links, np.zeros(len(inst.tip_joints)))
    stiffness = stiffness_matrix(inst)
    if motions is not None:
        inertia, stiffness = motions.T @ inertia @ motions, motions.T @ stiffness @ motions
    return np.asarray(np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)))


def mass_matrix(inst: FullForm, links: Array, angles: Array, speeds: Array | None = None) -> tuple[Array, Array]:
    """Return the mass matrix of the tip's joints, kg m^2, and the moments that their rates take, N m.

    Links as :func:`link_rows` has them, their first five columns; angles (rad) and rates (rad/s) of shape (joints,).
    """
    count = len(inst.tip_joints)
    rows = np.zeros((count, 10))
    rows[:, :5] = links[:, :5]
    matrix, bias = np.empty((1, count, count)), np.empty((1, count))
    moving = np.zeros(count) if speeds is None else speeds
    at = np.ascontiguousarray(angles, float)[np.newaxis]
    _core.chain_inertia(inst.core, rows, at, np.ascontiguousarray(moving, float)[np.newaxis], matrix, bias)
    return matrix[0], bias[0]
