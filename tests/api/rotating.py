"""Two mechanisms whose rotations are quaternions, and right calls of all that takes one, by name.

One carries what hangs on a hand that is prescribed; one floats, with a ball joint in its arm.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import leastaction as la
from leastaction import control, costs, identification, mechanics, optimal, starts, systems, viz
from leastaction.control.bridge import gymnasium, jax, python_control, torch
from leastaction.elements import JointForce, JointSpring, LinearSpring
from leastaction.limits import Ball, FinalTime, Keep, Oriented, Parameter, Pointing
from leastaction.numerics.arrays import Array

N = 6


def carried() -> la.Mechanism:
    """A rod and a geared link on a hand that is turned, a body on a string that is reeled beside it."""
    hand = la.ball("hand", kinematic=True, name="bar", mass=0.2, inertia=(1e-3,) * 3)
    link = la.ry("swing", name="link", mass=0.5, com=(0.0, 0.02, -0.2), inertia=(4e-3, 3e-3, 1e-3))
    geared = la.rx({"swing": 0.5}, offset=0.1, name="geared", mass=0.1, com=(0.0, 0.0, -0.1), inertia=(1e-3,) * 3)
    bob = [la.tz(-0.3), [la.ball("wrist", name="bob", mass=0.3, com=(0.0, 0.01, -0.1), inertia=(2e-3, 3e-3, 1e-3))]]
    tree = [
        la.tz("lift", kinematic=True),
        [hand, [la.tx(0.2, name="A"), [link, [*bob, geared]]]],
        la.tx(0.9, name="hook"),
    ]
    forces = [
        la.Gravity(),
        la.Damping(0.05),
        JointForce("swing", "u"),
        JointForce("wrist.wx", "torque"),
        JointSpring("swing", 1.0, name="s"),
    ]
    return la.Mechanism([*tree, la.tz("free", kinematic=True)], [*forces, LinearSpring("hook", "bob", 5.0, 0.4)])


def floating() -> la.Mechanism:
    """A body with an arm on a ball joint, on a string from a place that is moved along and one that is reeled."""
    base = la.free("base", name="hull", mass=2.0, inertia=(0.1, 0.2, 0.15))
    hand = la.ball("arm", name="hand", mass=0.3, com=(0.1, 0.0, 0.05), inertia=(2e-3, 3e-3, 1e-3))
    tip = la.rz("wrist", mass=0.1, inertia=(1e-3,) * 3, com=(0.05, 0.0, 0.0))
    tree = [
        base,
        [la.tx(0.2, name="A"), [hand, [la.tx(0.2, name="tip"), [tip]]]],
        la.tz(1.5),
        [la.tx("rail", kinematic=True, name="hook")],
    ]
    forces = [
        JointForce("wrist", "u"),
        JointForce("arm.wy", "torque"),
        la.Damping(0.05),
        JointSpring("wrist", 1.0, name="s"),
    ]
    return la.Mechanism(tree, [la.Gravity(), la.Distance("hook", "hull", "reel", name="string"), *forces])


@dataclass
class Case:
    """A mechanism with all that is made of it once."""

    make: Callable[[], la.Mechanism]

    @cached_property
    def m(self) -> la.Mechanism:
        return self.make()

    @cached_property
    def vi(self) -> la.MidpointVI:
        return la.MidpointVI(self.m, threads=1)

    @cached_property
    def q(self) -> Array:
        m = self.m
        known = {"reel": 1.5} if "reel" in m.coordinates else {}
        q = m.configuration({"wrist" if m.nc else "swing": 0.3, **known})
        for i, rotation in enumerate(m.tree.rotations):
            first = m.coordinates.index(rotation.quaternion[0])
            q[first : first + 4] = [np.cos(0.3 + i), np.sin(0.3 + i) * 0.6, 0.0, np.sin(0.3 + i) * 0.8]
        return la.project_configuration(m, q, hold=list(m.kinematic)).q

    @cached_property
    def v(self) -> Array:
        v = 0.2 * np.linspace(-1.0, 1.0, self.m.nv) * (np.arange(self.m.nv) < self.m.nd)
        return la.project_velocity(self.m, self.q, v, hold=list(self.m.kinematic)).v

    @property
    def t(self) -> Array:
        return np.linspace(0.0, 0.12, N + 1)

    @cached_property
    def run(self) -> la.Trajectory:
        return self.vi.simulate(self.vi.start(self.q, self.v), self.t)

    @cached_property
    def flow(self) -> la.ContinuousTrajectory:
        return la.simulate(self.m, self.q, self.v, self.t)

    @cached_property
    def system(self) -> la.MidpointSystem:
        return la.MidpointSystem(self.vi, self.t)

    @cached_property
    def pulled(self) -> la.MidpointSystem:
        return la.MidpointSystem(self.vi, self.t, multipliers=True)

    def price(self, system: Any = None) -> la.QuadraticCost:
        system = self.system if system is None else system
        x = self.run.x if system.nx == self.m.nx else np.hstack([self.run.x, np.zeros((N + 1, self.m.nc))])
        Q = np.zeros(system.ndx)
        Q[: self.m.nv] = 1.0
        return la.QuadraticCost(x, self.run.u, Q=Q, R=np.full(system.nu, 1e-2), space=system)

    @property
    def guess(self) -> tuple[Array, Array]:
        return self.run.x[0], self.run.u

    @cached_property
    def found(self) -> la.OptimizationResult:
        return la.optimize(self.system, self.price(), initial=self.guess, max_iterations=3)


def mechanism_calls(c: Case, folder: Path) -> dict[str, Callable[[], Any]]:
    """Return calls of what a mechanism, its integrator and its runs can be asked."""
    m, vi, q, v, run = c.m, c.vi, c.q, c.v, c.run
    frame = "bob" if m.nrho > 2 else "hand"
    law = lambda t, x: np.full(m.n_inputs, -0.01 * x[-1])  # noqa: E731
    K = np.zeros((m.n_inputs + m.nrho, m.nx))
    return {
        "str": lambda: (str(m), repr(m), m._repr_html_() if hasattr(m, "_repr_html_") else ""),
        "save": lambda: m.save(folder / "m.yaml"),
        "load": lambda: la.Mechanism.load(folder / "m.yaml") == m,
        "pickle": lambda: pickle.loads(pickle.dumps((m, vi, run, c.system))),
        "with_parameters": lambda: m.with_parameters({"s.stiffness": 2.0}),
        "with_elements": lambda: m.with_elements([la.Damping(0.1, name="more")]),
        "degrees_of_freedom": lambda: m.degrees_of_freedom(q),
        "with_frames": lambda: m.with_frames(frame, [la.tx(0.1, name="far")]),
        "parameters": lambda: m.parameters,
        "positions": lambda: m.positions(q),
        "frame_pose": lambda: m.frame_pose(q, frame),
        "frame_velocity": lambda: m.frame_velocity(q, v, frame),
        "frame_jacobian": lambda: m.frame_jacobian(q, frame),
        "frame_jacobian_derivative": lambda: m.frame_jacobian_derivative(q, frame),
        "frame_velocity_derivative": lambda: m.frame_velocity_derivative(q, v, frame, axes="frame"),
        "frame_pose_derivative": lambda: m.frame_pose_derivative(q, frame, order=3, along=[v]),
        "lagrangian": lambda: m.lagrangian(q, v).along(q=v, v=v).along(q=v).hessian,
        "potential": lambda: m.potential(q).along(q=v).hessian,
        "constraint": lambda: m.constraint(q).along(q=v).hessian,
        "force": lambda: m.force(q, v).along(q=v, v=v).hessian,
        "energy": lambda: m.energy(q, v),
        "momentum": lambda: m.momentum(q, v),
        "total_momentum": lambda: m.total_momentum(q, v),
        "mass_matrix": lambda: m.mass_matrix(q),
        "center_of_mass": lambda: m.center_of_mass(q),
        "named": lambda: m.named(q),
        "constraint_values": lambda: (m.constraint_values(q), m.constraint_jacobian(q), m.constraint_rank(q)),
        "redundancy": lambda: m.redundancy(q),
        "TapeMeasure": lambda: mechanics.TapeMeasure(m, ["world", frame]).rate(q, v),
        "equilibrium": lambda: la.equilibrium(m, q, inputs=np.zeros(m.n_inputs)),
        "project_configuration": lambda: la.project_configuration(m, q),
        "project_velocity": lambda: la.project_velocity(m, q, v),
        "check_consistent": lambda: mechanics.check_consistent(m, q),
        "find_contradiction": lambda: mechanics.find_contradiction(m, q),
        "configuration_by": lambda: mechanics.configuration_by(m, q, ["s.stiffness"]),
        "momentum_by": lambda: mechanics.momentum_by(m, q, v, ["A.value"]),
        "to_momentum": lambda: la.to_momentum(m, q, v),
        "to_velocity": lambda: la.to_velocity(m, q, la.to_momentum(m, q, v)),
        "legendre_jacobian": lambda: mechanics.legendre_jacobian(m, q, v),
        "gain_to_discrete": lambda: mechanics.gain_to_discrete(m, q, v, K, 0.01),
        "gain_to_continuous": lambda: mechanics.gain_to_continuous(m, q, v, K[:, : m.ndx], 0.01),
        "to_continuous": lambda: mechanics.to_continuous(run),
        "to_discrete": lambda: mechanics.to_discrete(c.flow, vi),
        "to_discrete sampled": lambda: mechanics.to_discrete(c.flow, vi, sampled=True),
        "simulate": lambda: c.flow,
        "ContinuousDynamics": lambda: mechanics.ContinuousDynamics(m).linearize(q, v),
        "ContinuousTrajectory.reactions": lambda: c.flow.reactions(),
        "ContinuousTrajectory.save": lambda: c.flow.save(folder / "flow.h5"),
        "MidpointVI.start_from_configurations": lambda: vi.start_from_configurations(run.q[0], run.q[1], 0.02),
        "MidpointVI.step": lambda: vi.step(run.state(2), 0.01),
        "MidpointVI.simulate by a law": lambda: vi.simulate(run.state(0), c.t, inputs=law),
        "MidpointVI.simulate inside": lambda: vi.simulate(run.state(0), c.t, inputs=law, law_at="midpoint"),
        "MidpointVI.simulate refined": lambda: vi.simulate(run.state(0), c.t, energy_tolerance=1e-4),
        "MidpointVI.linearize": lambda: vi.linearize(run),
        "MidpointVI.curvature": lambda: vi.curvature(run, vi.linearize(run), np.ones((N, m.ndx))),
        "MidpointVI.tensors": lambda: vi.tensors(run, 2),
        "MidpointVI.differentiate_by": lambda: vi.differentiate_by(run, ["A.value", "s.stiffness"]),
        "MidpointVI.sensitivity": lambda: vi.sensitivity(run, ["s.stiffness"], v=v),
        "MidpointVI.discrete_lagrangian": lambda: (
            vi.discrete_lagrangian(*run.q[:2], 0.02).along(q1=v).along(q2=v).hessian
        ),
        "MidpointVI.discrete_potential": lambda: vi.discrete_potential(*run.q[:2], 0.02).along(q1=v).hessian,
        "MidpointVI.discrete_force": lambda: vi.discrete_force(*run.q[:2], None, 0.02)[1].along(q1=v).hessian,
        "MidpointVI.driving_force": lambda: vi.driving_force(run),
        "MidpointVI.balance": lambda: vi.balance(run),
        "Trajectory": lambda: (
            run["wrist" if m.nc else "swing"],
            run.velocity(frame),
            run.energy(),
            run.tensions(),
            str(run),
        ),
        "Trajectory.reactions": lambda: run.reactions(),
        "Trajectory.save": lambda: (run.save(folder / "run.h5"), run.save(folder / "run.csv")),
        "Trajectory.dataset": lambda: run.dataset(),
        "open": lambda: la.open(folder / "run.h5"),
        "Trajectory.to_xarray": lambda: run.to_xarray(),
        "Trajectory.to_pandas": lambda: run.to_pandas(),
    }


def optimal_calls(c: Case, folder: Path) -> dict[str, Callable[[], Any]]:
    """Return calls of what optimises, controls and finds numbers of a mechanism."""
    m, vi, system, run = c.m, c.vi, c.system, c.run
    frame, hinge = ("hand", "wrist") if m.nc else ("bob", "swing")
    price, guess, few = c.price(), c.guess, {"max_iterations": 2}
    wanted = {hinge: np.full(N + 1, 0.3), frame: m.positions(run.q, [frame])[:, 0]}
    rotation = m.frame_pose(run.q, frame)[:, :3, :3]
    ball = "arm" if m.nc else "wrist"
    quaternion = run.q[:, m.coordinates.index(f"{ball}.qw") :][:, :4]
    by_law = lambda t, x: np.zeros(system.nu)  # noqa: E731
    measured = {
        hinge: run[hinge],
        ball: quaternion,
        frame: wanted[frame],
        f"rate of {ball}.wx": run.velocity(f"{ball}.wx"),
    }
    lengths = {"reel": 1.5} if m.nc else {}

    def limited(*limits: Any, on: Any = None, **more: Any) -> Any:
        where = system if on is None else on
        start = guess if on is None else (np.append(guess[0], np.zeros(where.nx - m.nx)), guess[1])
        return la.optimize(where, c.price(where), initial=start, limits=limits, max_iterations=2, **more)

    def continuous() -> Any:
        flow = la.MechanismSystem(m)
        Q = np.zeros(m.ndx)
        Q[: m.nv] = 1.0
        cost = la.ContinuousQuadraticCost(
            c.flow.x[0], np.zeros(flow.nu), Q=Q, R=np.ones(flow.nu), Q_final=Q, space=flow
        )
        return la.optimize(flow, cost, horizon=(0.0, 0.12), initial=(c.flow.x[0], np.zeros(flow.nu)), max_iterations=2)

    def flowing(cost: Any) -> Any:
        x, u = c.flow.x[:3], np.zeros((3, la.MechanismSystem(m).nu))
        return cost.gradient(x, u, c.flow.t[:3]), cost.hessian(x, u, c.flow.t[:3])

    def filtered(kind: str) -> Any:
        kalman = control.KalmanFilter(
            system, measure=["*q?", hinge], noise=0.01, process=1e-3, x=run.x[0], spread=0.1, kind=kind
        )
        kalman.correct(run.x[0][[i for i, n in enumerate(system.state_names) if n in kalman.readings.names]])
        return kalman.predict(run.u[0])

    def horizon() -> Any:
        estimator = control.MovingHorizonEstimator(
            system, measure=[hinge], noise=0.01, process={"p_*": 1e-3}, x=run.x[0], horizon=3
        )
        estimator.correct([0.3])
        return estimator.predict(run.u[0])

    def identified(**given: Any) -> Any:
        start = (c.q, c.v)
        given = {"start": start, "inputs": lengths, **given}
        return identification.identify(vi, identification.Experiment(c.t, measured, 0.01, **given), ["s.stiffness"])

    def coarser(t: Array) -> tuple[Any, Any]:
        other = la.MidpointSystem(vi, t)
        return other, costs.tracking(other, {hinge: 1.0})

    vectors = dict.fromkeys(m.inputs, (-1.0, 1.0))
    drawn = {"reward": lambda x, u: 0.0, "start": lambda rng: run.x[0], "actions": vectors}
    return {
        "optimize": lambda: c.found,
        "optimize by gaps": lambda: la.optimize(system, price, initial=(run.x, run.u), shooting="multiple", **few),
        "Optimizer": lambda: optimal.Optimizer(system, price, **few).run(guess),
        "result": lambda: (
            c.found.save(folder / "found.h5"),
            la.open(folder / "found.h5"),
            str(c.found),
            c.found.trajectory,
        ),
        "resume": lambda: la.optimize(system, price, resume=c.found, max_iterations=4),
        "check_derivatives": lambda: optimal.check_derivatives(system, run.x, run.u, cost=price).ok,
        "check_derivatives multipliers": lambda: (
            optimal.check_derivatives(c.pulled, np.hstack([run.x, np.zeros((N + 1, m.nc))]), run.u).ok
        ),
        "controllability": lambda: la.controllability(system, run.x, run.u),
        "ProjectionOperator": lambda: optimal.ProjectionOperator(system, c.found.K),
        "WindowSystem": lambda: optimal.WindowSystem(system, 1, 4).linearize(run.x[1:5], run.u[1:4]),
        "cost_along": lambda: optimal.cost_along(system, price, (run.x, run.u)),
        "PricedLimits": lambda: optimal.PricedLimits(price, system, []),
        "RateCost": lambda: la.optimize(system, costs.RateCost(price, system, {"*": 1e-3}), initial=guess, **few),
        "SmoothCost": lambda: costs.SmoothCost(price, system, {"*": 1e-3}).value(run.x, run.u),
        "PlaceCost": lambda: costs.PlaceCost(price, system, {frame: [0.0, 0.0, 0.0]}, {frame: 1.0}).value(run.x, run.u),
        "DistanceCost": lambda: costs.DistanceCost(price, system, [(frame, "world")], [1.0]).value(run.x, run.u),
        "OrientationCost": lambda: costs.OrientationCost(price, system, {frame: np.eye(3)}, {frame: 1.0}).value(
            run.x, run.u
        ),
        "CostOfConfigurations": lambda: systems.CostOfConfigurations,
        "tracking": lambda: costs.tracking(system, {hinge: 1.0, "*.v": 0.1, f"{ball}.w*": 2.0}, {ball: rotation}),
        "Bound": lambda: limited(la.Bound(hinge, -2.0, 2.0)),
        "rates": lambda: limited(la.Bound("*", -50.0, 50.0, of="rate")),
        "accelerations": lambda: limited(la.Bound("*", -1e4, 1e4, of="acceleration")),
        "momenta": lambda: limited(la.Bound("*", -1e4, 1e4, of="momentum")),
        "input rates": lambda: limited(la.Bound("*", -1e4, 1e4, of="input rate")),
        "tensions": lambda: limited(la.Bound("*", -1e4, 1e4, of="tension"), on=c.pulled) if m.nc else None,
        "Keep": lambda: limited(Keep(frame, outside=Ball([9.0, 9.0, 9.0], 0.5))),
        "Oriented": lambda: limited(Oriented(frame, np.eye(3), within=3.1)),
        "Pointing": lambda: limited(Pointing(frame, [0, 0, 1.0], [0, 0, 1.0], within=3.1)),
        "unknowns": lambda: limited(
            unknowns=[FinalTime(0.05, 0.5, price=1.0), Parameter("s.stiffness", 0.1, 9.0, weight=1.0)]
        ),
        "lengths as unknowns": lambda: limited(unknowns=[Parameter("A.value", 0.01, 0.9, weight=1.0)]),
        "free start": lambda: limited(free_start=True),
        "follow": lambda: la.follow(
            m, {hinge: wanted[hinge], ball: quaternion}, t=c.t, start=run.state(0), max_iterations=2
        ),
        "follow frames": lambda: la.follow(m, {frame: rotation}, t=c.t, start=run.state(0), max_iterations=2),
        "warm_start": lambda: la.warm_start((run.x, run.u), system, la.MidpointSystem(vi, np.linspace(0.0, 0.12, 9))),
        "coarse_to_fine": lambda: starts.coarse_to_fine(coarser, c.t, initial=guess, factors=(2, 1), **few),
        "receding_horizon": lambda: starts.receding_horizon(
            system, price, initial=guess, window=3, keep=2, max_iterations=2
        ),
        "relax": lambda: (
            starts.relax(system, price, initial=guess, max_stages=3, stage_iterations=3, max_iterations=2)
            if m.nc
            else None
        ),
        "embed": lambda: starts.embed(system, price, initial=guess, max_iterations=2),
        "MPC": lambda: control.MPC(system, price, [la.Bound(hinge, -2.0, 2.0)])(run.x[0], 0.0),
        "close_loop": lambda: control.close_loop(vi, by_law, run.x[0], c.t, measure=[hinge], noise=0.01, substeps=2),
        "disturbed": lambda: control.close_loop(vi, by_law, run.x[0], c.t, disturbance=1e-4, substeps=2),
        "monte_carlo": lambda: control.monte_carlo(lambda rng: control.close_loop(vi, by_law, run.x[0], c.t), 2),
        "KalmanFilter": lambda: filtered("extended"),
        "KalmanFilter unscented": lambda: filtered("unscented"),
        "MovingHorizonEstimator": horizon,
        "simulate_many": lambda: control.simulate_many(vi, run.x[[0, 0]], c.t),
        "ManyRuns": lambda: control.simulate_many(vi, run.x[[0, 0]], c.t).bands().quantiles(hinge),
        "linearize_many": lambda: control.linearize_many(vi, c.t, np.array([run.x]), np.array([run.u])),
        "optimize_many": lambda: control.optimize_many(system, price, [guess, guess], workers=1, max_iterations=1),
        "identify": lambda: identified(),
        "identify with a fixed start": lambda: identified(free_start=False),
        "play": lambda: la.play(system, (run.x, run.u)),
        "gymnasium.environment": lambda: gymnasium.environment(system, **drawn).reset(),
        "gymnasium.vector_environment": lambda: gymnasium.vector_environment(system, 2, **drawn).reset(),
        "jax.roll_out": lambda: jax.roll_out(system)(run.x[0], run.u),
        "jax.optimum": lambda: jax.optimum(system, price, u=run.u)(run.x[0]).cost,
        "torch.roll_out": lambda: torch.roll_out(system)(run.x[0], run.u),
        "python_control.state_space": lambda: python_control.state_space(system, run.x[0], run.u[0]),
        "MechanismSystem": continuous,
        "tracking in continuous time": lambda: flowing(
            costs.tracking(la.MechanismSystem(m), {hinge: 1.0, "*.v": 0.1, f"{ball}.w*": 2.0}, {ball: rotation[0]})
        ),
        "ContinuousPlaceCost": lambda: flowing(costs.ContinuousPlaceCost(la.MechanismSystem(m), {frame: np.zeros(3)})),
        "ContinuousOrientationCost": lambda: flowing(
            costs.ContinuousOrientationCost(la.MechanismSystem(m), {frame: np.eye(3)})
        ),
        "show": lambda: la.show(run).save(folder / "run.html"),
        "show a mechanism": lambda: la.show(m).save(folder / "m.html"),
        "gltf": lambda: la.show(run).save(folder / "run.glb"),
    }


def drawing_calls(c: Case, folder: Path) -> dict[str, Callable[[], Any]]:
    """Return calls of what is drawn of it."""
    del folder
    names = [n for n in viz.__all__ if n.startswith("plot_")]
    others: dict[str, Any] = {
        "plot_descent": lambda: viz.plot_descent(c.system, c.price(), c.guess),
        "plot_convergence": lambda: viz.plot_convergence(c.found),
        "plot_feedback": lambda: viz.plot_feedback(c.found),
        "plot_snapshots": lambda: viz.plot_snapshots(viz.mechanism_scene(c.m, c.run.t, c.run.q)),
        "plot_limits": None, "plot_strings": None, "plot_tracking": None,  # of arrays, or of limits
    }  # fmt: skip
    if not c.m.nc:
        others["plot_reactions"] = None  # those of constraints
    found = {n: others.get(n, lambda n=n: getattr(viz, n)(c.run)) for n in names}
    return {n: call for n, call in found.items() if call is not None}
