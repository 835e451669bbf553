"""What Python can say of a mechanism comes back from its file bit by bit."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

import leastaction as la
from api.mechanism_files.back import check_back, from_text, text_of
from conformance.loader import load_case
from fuzz.describe import Description, build, descriptions
from fuzz.pieces import ELEMENTS
from fuzz.questions import changes
from leastaction.errors import DescriptionError, ModelFileError
from leastaction.mechanics import Potential
from leastaction.mechanics.mechanism.record import mechanism_type
from leastaction.mechanics.mechanism.record.schema import SCHEMA_FILE
from leastaction.models import MODELS
from leastaction.models import build as build_model
from leastaction.models.broad_hand import broad_hand
from leastaction.models.chain import pendulum_chain
from leastaction.numerics.documents import schema_text

pytestmark = pytest.mark.filterwarnings("ignore::leastaction.errors.UnitWarning")
CASES = Path(os.environ.get("CONFORMANCE_DIR") or Path(__file__).resolve().parents[4] / "shared" / "conformance")
PYTHON = {"PythonPotential", "PythonConstraint", "PythonForce"}


@pytest.mark.parametrize("name", [*MODELS, "broad_hand"])
def test_every_model_comes_back(name: str, tmp_path: Path) -> None:
    mechanism = broad_hand() if name == "broad_hand" else build_model(name)
    check_back(mechanism)
    for ending in ("yaml", "yml", "json"):
        path = mechanism.save(tmp_path / f"m.{ending}")
        assert la.Mechanism.load(path) == mechanism
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.json", "m.yaml", "m.yml"]


@pytest.mark.parametrize("name", ["cart_pendulum", "puppet_arm", "marionette"])
def test_a_motion_is_the_same(name: str) -> None:
    mechanism = build_model(name)
    runs = []
    for m in (mechanism, from_text(text_of(mechanism))):
        vi = la.MidpointVI(m)
        q = la.project_configuration(m, m.configuration(default=0.1), move_kinematic=True).q
        runs.append(vi.simulate(vi.start(q, np.zeros(m.nq)), 0.01 * np.arange(21)))
    for array in ("q", "p", "lam"):
        assert getattr(runs[0], array).tobytes() == getattr(runs[1], array).tobytes()


def test_conformance_cases_come_back() -> None:
    paths = sorted(CASES.glob("*.json"))
    if not paths:
        pytest.skip(f"no conformance cases in {CASES}")
    taken = 0
    for path in paths:
        try:
            mechanism = load_case(path).mechanism
        except (KeyError, TypeError):  # another kind of file
            continue
        if mechanism is not None:
            check_back(mechanism)
            taken += 1
    assert taken > 5


@pytest.mark.parametrize("kind", ELEMENTS)
def test_random_descriptions_come_back(kind: str) -> None:
    taken: list[str] = []

    @hypothesis.seed(list(ELEMENTS).index(kind))
    @settings(max_examples=6, database=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate])
    @given(it=descriptions(kind))
    def one(it: Description) -> None:
        if it.damage is not None:
            return
        mechanism = build(it)
        if it.changes is not None:
            mechanism = mechanism.with_parameters(changes(mechanism, it.seed, it.changes))
        if PYTHON & set(it.types):
            with pytest.raises(ModelFileError, match="Python"):
                text_of(mechanism)
        else:
            check_back(mechanism)
        taken.append(kind)

    one()
    assert taken


def test_every_element_in_its_derivative_case_comes_back() -> None:
    pytest.importorskip("jax")
    from derivatives.elements.cases import CASES as ALL
    from derivatives.elements.cases import problem

    taken = 0
    for name in ALL:
        mechanism = problem(name, 1).mechanism
        if any(type(element).__name__ in PYTHON for element in mechanism.elements.values()):
            continue
        check_back(mechanism)
        taken += 1
    assert taken > 40


def test_all_that_frames_can_say() -> None:
    theta, phi = la.var("theta"), la.var("phi")
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    tree = la.world("ground")
    arm = tree.revolute("theta", axis=(1.0, 2.0, 3.0), point=(0.1, 1 / 3, -2e-7), name="arm", mass=0.3, com=(0.1, 0, 0))
    arm.screw(2.0 * theta - phi + 0.3, axis="-z", pitch=1 / 7, point=(0, 0, 5.0), mass=1.0, inertia=(0.1, 0.1, 0.1))
    arm.screw("yes", axis=(0.1, 0.2, 0.3), pitch=-0.01, mass=1e-3, inertia=(1, 1, 1, 0.1, 0.2, -0.1))
    arm.twist({"phi": -1.0}, linear=(1.0, 0.5, 0.0), angular=(0.0, 0.0, 0.3), offset=-0.1, kinematic=False, mass=2)
    arm.prismatic("1.5", axis=(1.0, 1.0, 0.0), kinematic=True).pose(rotation=turn, translation=(0, 1e300, 0))
    arm.tx(2 * la.var("r") - 3 * phi, kinematic=["r"], name="both", bodies=[la.Body(1.0), la.Body(2.0, com=(0, 0, 1))])
    heavy = la.Body(1.0, inertia=(1.0, 5.0, 1.0), allow_nonphysical=True)
    arm.pose(name="disc", bodies=[heavy]).pose(np.eye(4)).rx(1e-3).ry("90 deg", mass=1.0, inertia=(1, 1, 1))
    ball = tree.ball("hip", axes="zxz", name="leg", mass=1.0, inertia=(1.0, 1.0, 1.0))
    assert ball.parent is not None
    ball.parent.tx(0.5, mass=0.1).tx("no", mass=0.2)
    ball.universal(["a", 0.5 * la.var("a") + 0.2], axes="xz", kinematic=["a"], mass=1.0)
    tree.free("b", axes="xyz", mass=1.0, inertia=(1.0, 1.0, 1.0), kinematic=["b.x"])
    tree.free("c", mass=1.0, inertia=(1.0, 1.0, 1.0))
    tree.tx(-0.0)
    check_back(la.Mechanism(tree, dynamic=None))


def test_files_from_before_quaternions_have_angles() -> None:
    """Then joints turned about x, y and z where nothing else was said."""
    text = """
leastaction: mechanism 1
frames:
- {type: ball, variables: hip, bodies: [{mass: 1.0, inertia: [1.0, 1.0, 1.0]}]}
- {type: free, variables: body, bodies: [{mass: 1.0, inertia: [1.0, 1.0, 1.0]}]}
- {type: ball, variables: [a, b, c], bodies: [{mass: 1.0, inertia: [1.0, 1.0, 1.0]}]}
"""
    m = from_text(text)
    assert m.variables[:3] == ("hip.rx", "hip.ry", "hip.rz")
    assert m.variables[6:] == ("body.rx", "body.ry", "body.rz", "a", "b", "c")
    assert check_back(m) == m
    assert "quaternion" not in text_of(m)


def test_a_chain_deeper_than_text_nests() -> None:
    check_back(pendulum_chain(40))
    tree: Any = la.world()
    for k in range(300):
        tree = tree.rz(f"q{k}").tx(1.0, mass=1.0)
        if k % 50 == 3:
            tree.ty(0.5)
    check_back(la.Mechanism(tree, [la.Gravity()]))


def test_changed_numbers_keep_the_names_that_were_made_up() -> None:
    tree = la.world()
    tree.rz("a").tx(1.0, mass=1.0)
    tree.rz(2.0 * la.var("a")).ty(1.0, mass=1.0)
    tree.screw("s", axis="x", pitch=0.1, mass=1.0)
    mechanism = la.Mechanism(tree, [la.Gravity(frames=["rz(a)/tx(1)"]), la.JointSpring("a", 3.0, name="spring")])
    changed = mechanism.with_parameters(
        {
            "rz(a)/tx(1).value": 2.5, "rz(2 a).factor.a": 3.0, "s.pitch": 0.3, "spring.stiffness": 1 / 3,
            "gravity(rz(a)/tx(1)).mass.rz(a)/tx(1)": 0.25,
        }
    )  # fmt: skip
    again = check_back(changed)
    assert again.frames == mechanism.frames
    assert again != mechanism


def test_orders_of_names_come_back() -> None:
    tree = la.world()
    tree.rz("a", mass=1.0, inertia=(1, 1, 1)).tx("b", mass=1.0).ty("r", kinematic=True).tz("s", kinematic=True)
    forces = [la.JointForce("a", "u"), la.JointForce("b", "w")]
    mechanism = la.Mechanism(tree, forces, dynamic=["b", "a"], kinematic=["s", "r"], inputs=["w", "u"])
    again = check_back(mechanism)
    assert (again.variables, again.inputs) == (("b", "a", "s", "r"), ("w", "u"))
    assert mechanism.with_elements([la.JointForce("a", "x")]) != mechanism


def test_expressions_come_back() -> None:
    pytest.importorskip("sympy")
    import sympy

    from leastaction.mechanics import expressions as ex

    tree = la.world()
    tree.rz("it's", mass=1.0, inertia=(1, 1, 1)).tx("lift", name='a "b"', mass=1.0).tx(1.0, name="end")
    d, lift = ex.distance('a "b"', "end"), ex.variable("lift")
    elements = [
        la.ExpressionPotential(ex.parameter("k", 1 / 3) * (d - 0.1) ** 2 / 2 + sympy.exp(-(lift**2)) / 3, name="V"),
        la.ExpressionPotential(ex.direction("end", (1, 2, 3))[0] * sympy.pi + sympy.atan2(lift, 2)),
        la.ExpressionConstraint(lift - 0.01 * (1 + sympy.sin(ex.variable("it's"))), name="cam"),
        la.ExpressionForce(-0.1 * ex.rate(d) * ex.input_("u") + ex.coordinate(lift**2), along=d),
        la.ExpressionForce(-ex.speed("lift"), along="lift"),
        la.ExpressionForce(0.5 + lift * (1 / 7) + 1e-300, along="it's"),
    ]
    mechanism = la.Mechanism(tree, elements)
    again = check_back(mechanism)
    compiled, other = elements[3].compiled, list(again.elements.values())[3].compiled
    assert compiled.code.instructions.tolist() == other.code.instructions.tolist()
    check_back(mechanism.with_parameters({"V.k": 0.7}))
    with pytest.raises(ModelFileError, match=r"does not come back"):
        text_of(la.Mechanism(tree, [la.ExpressionPotential(sympy.Add(lift, lift, evaluate=False))]))


class Square(la.PythonFunction):
    """The square."""

    def value(self, z):
        return z @ z

    def gradient(self, z):
        return 2 * z

    def hessian(self, z):
        return 2 * np.eye(len(z))


def test_what_no_file_can_say_is_an_error_that_says_why(tmp_path: Path) -> None:
    element = la.PythonPotential(Square(), variables=["x"], name="well")
    mechanism = la.Mechanism([la.tx("x", mass=1.0)], [element])
    with pytest.raises(
        ModelFileError, match=r"PythonPotential 'well': it calls functions in Python.*ExpressionPotential"
    ):
        mechanism.save(tmp_path / "m.yaml")

    class Own(Potential):
        called = "own"

        def add_to(self, core: Any) -> None: ...

        def describe(self) -> str:
            return ""

    with pytest.raises(ModelFileError, match="a class of your own"):
        la.Mechanism([la.tx("x", mass=1.0)], [Own()]).save(tmp_path / "m.yaml")
    assert not list(tmp_path.iterdir())
    assert mechanism == la.Mechanism([la.tx("x", mass=1.0)], [element])


def test_mechanisms_differ_in_whatever_is_different() -> None:
    def make(**changes: Any) -> la.Mechanism:
        it: dict[str, Any] = {"mass": 1.0, "name": "bob", "g": -9.81, "axis": "z", "order": None} | changes
        tree = la.world()
        tree.revolute("a", axis=it["axis"]).tx(1.0, name=it["name"], mass=it["mass"]).tx("b", mass=1.0)
        return la.Mechanism(tree, [la.Gravity((0, it["g"], 0))], dynamic=it["order"])

    first = make()
    assert first == make()
    assert hash(first) == hash(make())
    assert len({first, make(), make(mass=2.0)}) == 2
    for change in ({"mass": 2.0}, {"name": "bab"}, {"g": -9.8}, {"axis": "y"}, {"order": ["b", "a"]}):
        assert first != make(**change), change
    assert first != "a mechanism"
    assert first.with_parameters({"bob.mass": 1.0}) == first


def test_the_schema_that_is_shipped_is_the_one_of_the_code() -> None:
    assert SCHEMA_FILE.read_text() == schema_text(mechanism_type()), (
        "write it anew: python -m leastaction.mechanics.mechanism.record.schema"
    )


def test_written_by_hand() -> None:
    by_hand = from_text(
        """
        leastaction: mechanism 1
        frames:
          - type: tx
            value: x
            name: cart
            mass: 10
            children:
              - {type: rz, value: theta, name: pole}
          - {type: ty, value: -1, name: bob, mass: 1, parent: pole}
        elements:
          - type: Gravity
            vector: [0, -98e-1, 0]
          - {type: Damping, coefficients: 1e-2}
          - {type: JointForce, variable: x, input: x-force}
          - {type: NonlinearSpring, on: {x: 2}, force: {x: [-1, 0, 1], y: [-1, 0, 1]}}
          - {type: ExpressionForce, expression: "-parameter('c', 0.5) * speed('x')", along: x}
          - {type: ExpressionForce, expression: 1, along: {expression: "distance('cart', 'bob')"}}
        """
    )
    tree = la.world()
    cart = tree.tx("x", name="cart", mass=10.0)
    cart.rz("theta", name="pole").ty(-1.0, name="bob", mass=1.0)
    from leastaction.mechanics import expressions as ex

    elements = [
        la.Gravity((0.0, -9.8, 0.0)),
        la.Damping(0.01),
        la.JointForce("x", "x-force"),
        la.NonlinearSpring({"x": 2.0}, la.Curve([-1, 0, 1], [-1, 0, 1])),
        la.ExpressionForce(-ex.parameter("c", 0.5) * ex.speed("x"), along="x"),
        la.ExpressionForce(1, along=ex.distance("cart", "bob")),
    ]
    assert by_hand == la.Mechanism(tree, elements)


def test_products_with_a_sign_or_a_number_come_back() -> None:
    """Two by two, SymPy takes the number of a product into a sum: another expression, of the same value."""
    sympy = pytest.importorskip("sympy")
    from leastaction.expressions import point, variable
    from leastaction.mechanics.expressions.text import expression_of, expression_text

    x, y = variable("x"), variable("y")
    products = -((x**2 + 1) * sympy.sqrt(y)), -((x + 1) * (y + 2) / 3), 2 * ((x + 1) * y), -((x + 1) / (y * (x + 2)))
    for product in products:
        assert expression_of(expression_text(product)) == product
    assert expression_of("-(variable('x') + 1)") == -x - 1
    assert expression_of("dot(-2*point('a')/4, point('b'))") == -point("a").dot(point("b")) / 2
    with pytest.raises(DescriptionError, match="is no formula: only a scalar divides"):
        expression_of("point('a')/point('b')")
