"""No step allocates, whatever the mechanism: over twice the steps the same number of blocks of memory is taken."""

from __future__ import annotations

from numerics.preload import run

PROGRAM = """
def blocks_of(call):
    # The least of several times: the interpreter keeps and gives back blocks of its own, as NumPy does small ones.
    taken = []
    for _ in range(3):
        before = memory.blocks_taken()
        call()
        taken.append(memory.blocks_taken() - before)
    return min(taken)


counts = {}
for name, build in MODELS.items():
    mechanism = build()
    integrator = MidpointVI(mechanism, threads=1)
    state = started(name, integrator)
    dt = 1e-4 if name == "andrews" else 1e-3

    def simulated(steps):
        return integrator.simulate(state, dt * np.arange(steps + 1))

    def rolled_out(steps):
        system, x, u = systems[steps]
        K = np.zeros((steps, system.nu, system.nx))
        return lambda: system.rollout(x[0], x, u, K, 0, steps)

    systems = {}
    for steps in (200, 400):
        run = simulated(steps)
        system = MidpointSystem(integrator, run.t)
        u = np.hstack([run.u, run.q[1:, mechanism.nd :]])[:, : system.nu]
        systems[steps] = (system, run.x, u)

    def linearized(steps):
        system, x, u = systems[steps]
        return lambda: system.linearize(x, u)

    def linearized_again(steps):
        # As an optimisation or a predictive controller does.
        system, x, u = systems[steps]
        z = np.ones((steps, system.nx))
        memory = system.linearize(x, u)
        return lambda: system.linearize(x, u, out=memory).curvature(z)

    def at_instants(steps):
        # Without inputs the same motion, wherever their forces act.
        plain, x, u = systems[steps]
        system = PulledSystem(integrator, plain.t, at_instants=mechanism.inputs)
        memory, K, z = system.linearize(x, u), np.zeros((steps, system.nu, system.nx)), np.ones((steps, system.nx))

        def once():
            system.rollout(x[0], x, u, K, 0, steps)
            system.linearize(x, u, out=memory).curvature(z)

        return once

    dynamics = ContinuousDynamics(mechanism, threads=1)

    def samples(question, steps):
        q = np.tile(state.q, (10 * steps, 1))
        return lambda: question(q, np.zeros_like(q))

    counts[name] = {}
    for what, call in {
        "simulate": lambda steps: lambda: simulated(steps),
        "rollout": rolled_out,
        "linearize": linearized,
        "linearize again, second order": linearized_again,
        "accelerations": lambda steps: samples(dynamics.accelerations, steps),
        "accelerations' derivatives": lambda steps: samples(dynamics.linearize, steps),
    }.items():
        counts[name][what] = (blocks_of(call(400)) - blocks_of(call(200))) / 200
    if mechanism.inputs and not mechanism.nc:
        counts[name]["at instants"] = (blocks_of(at_instants(400)) - blocks_of(at_instants(200))) / 200
print(json.dumps(counts))
"""


def test_no_step_allocates() -> None:
    counts = run(PROGRAM)
    assert "bricard" in counts
    assert any("at instants" in calls for calls in counts.values())
    assert counts == {name: dict.fromkeys(calls, 0) for name, calls in counts.items()}
