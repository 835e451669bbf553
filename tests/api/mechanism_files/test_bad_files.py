"""A file that is wrong is a named error with the line and the place, and nothing is half written."""

from __future__ import annotations

import contextlib
import copy
import errno
import json
import os
import random
from pathlib import Path
from typing import Any

import pytest

import leastaction as la
from api.mechanism_files.back import from_text, text_of
from leastaction.errors import DescriptionError, LeastActionError, ModelFileError, OutputError
from leastaction.mechanics.mechanism.record import plan_data
from leastaction.models import build
from leastaction.numerics.documents import document_text

GOOD = """\
leastaction: mechanism 1
frames:
  - type: tx
    value: x
    name: cart
    mass: 10.0
    children:
      - type: rz
        value: theta
        name: pole
        children:
          - {type: ty, value: -1.0, name: bob, mass: 1.0}
elements:
  - type: Gravity
  - {type: JointForce, variable: x, input: push}
"""


def test_the_good_one_is_good() -> None:
    assert from_text(GOOD).variables == ("x", "theta")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass: 10.0", "mass: heavy", r"line 6: frames\[0\]\.mass: got 'heavy', expected a number$"),
        ("mass: 10.0", "mass: 10 kg", r"line 6: frames\[0\]\.mass: got '10 kg'.*without a unit"),
        ("mass: 10.0", "mass: true", r"frames\[0\]\.mass: got True, expected a number"),
        ("mass: 10.0", "mass: .nan", r"line 3: frames\[0\]: frame 'cart': mass: .*nan"),
        ("mass: 10.0", "mass: -1", r"frames\[0\]: frame 'cart': mass: got -1.0 kg"),
        ("mass: 10.0", "mas: 10.0", r"line 6: frames\[0\]\.mas: unknown key; did you mean 'mass'\?"),
        ("mass: 10.0", "com: [1, 2]\n    mass: 1", r"frames\[0\]\.com: got \[1, 2\], expected a list of 3 or more"),
        ("mass: 10.0", "mass: 10.0\n    mass: 1.0", r"line 7, column 5: no YAML: .*'mass' stands twice"),
        ("mass: 1.0}", "mass: [1]}", r"line 12: frames\[0\]\.children\[0\]\.children\[0\]\.mass: got \[1\], expected"),
        ("type: rz", "type: rq", r"children\[0\]\.type: got 'rq'; the choices are .*'rz'"),
        ("      - type: rz\n        value", "      - value", r"children\[0\]: the key 'type' is missing; the cho"),
        ("value: theta", "value: 90 deg", r"children\[0\]: value: got '90 deg', expected a number in metres or r"),
        ("        value: theta\n", "", r"line 8: frames\[0\]\.children\[0\]: the key 'value' is missing"),
        ("value: theta", "value: {theta: two}", r"value\.theta: got 'two', expected a number"),
        ("name: bob", "name: cart", r"another frame is called 'cart'"),
        ("name: bob", "parent: cart", r"children\[0\]\.parent: a child has its parent"),
        ("elements:", "  - {type: tx, value: 1.0, parent: carts}\nelements:", r"line 13: frames\[1\]\.parent: unkn"),
        ("type: Gravity", "type: Gravitas", r"elements\[0\]\.type: got 'Gravitas'; did you mean 'Gravity'"),
        ("type: Gravity", "type: Gravity\n    vector: down", r"elements\[0\]\.vector: got 'down', expected a list"),
        ("variable: x", "variable: y", r"line 15: elements\[1\]: JointForce .*unknown variable 'y'"),
        ("type: Gravity", "type: PythonForce", r"elements\[0\]\.type: got 'PythonForce'"),
        ("input: push}", "input: push, gain: 2}", r"elements\[1\]\.gain: unknown key"),
        ("mechanism 1", "mechanism 7", r"leastaction: got version 7, expected 'mechanism 1'; update"),
        ("mechanism 1", "problem 1", r"leastaction: got 'problem 1', expected 'mechanism 1'"),
        ("leastaction: mechanism 1\n", "", r"the key 'leastaction' is missing; the first line is `leastaction: mech"),
        ("elements:", "dynamic: [x]\nelements:", r"line 13: dynamic: the order of the .* lacks 'theta'"),
        ("elements:", "element:", r"line 13: element: unknown key; did you mean 'elements'"),
        ("frames:", "frames:\n  - {type: ball, variables: [1]}", r"frames\[0\]: ball: expected a name or a list of 3"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(ModelFileError, match=message):
        from_text(GOOD.replace(old, new, 1))


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("__import__('os').system('true')", "expected numbers"),
        ("variable('x').__class__", "expected numbers"),
        ("x + 1", "a variable is variable"),
        ("variable('x') +", "is no formula"),
        ("point('bob')", "expected a scalar"),
        ("9**9**9", "exponent"),
        ("variable(1)", "a name is a string"),
        ("sin()", "is no formula"),
        ("[1 for _ in range(3)]", "expected numbers"),
    ],
)
def test_an_expression_runs_nothing(expression: str, message: str) -> None:
    pytest.importorskip("sympy")
    text = GOOD + f'  - {{type: ExpressionPotential, expression: "{expression}"}}\n'
    with pytest.raises(ModelFileError, match=rf"line 16: elements\[2\].*{message}"):
        from_text(text)


def test_broken_text_has_its_line(tmp_path: Path) -> None:
    cases: dict[str, tuple[bytes, str]] = {
        "a.yaml": (b"leastaction: mechanism 1\nframes: [\n  {type: tx\n", r"a\.yaml, line 4, column \d+: no YAML"),
        "b.json": (b'{"leastaction": "mechanism 1",\n "frames": [}', r"b\.json, line 2, column 13: no JSON"),
        "c.yaml": (b"", r"c\.yaml: it is empty"),
        "d.yaml": (b"- a\n- b\n", r"expected a mapping"),
        "e.yaml": (b"a: \xff\n", r"e\.yaml, line 1: it is no text in UTF-8"),
        "f.json": (b'{"a": 1, "a": 2}', r"'a' stands twice"),
        "g.yaml": (b"? [a, b]\n: c\n", r"a key is a list"),
        "h.yaml": (b"a: !!python/object/apply:os.system ['true']\n", r"h\.yaml, line 1.*no YAML"),
        "i.txt": (b"a: 1", r"ending '\.txt', expected one of \.yaml"),
        "j.json": (b"[" * 100_000, r"nested too deeply"),
    }
    for name, (content, message) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ModelFileError, match=message):
            la.Mechanism.load(tmp_path / name)
    with pytest.raises(ModelFileError, match="there is no such file"):
        la.Mechanism.load(tmp_path / "none.yaml")
    (tmp_path / "folder.yaml").mkdir()
    with pytest.raises(ModelFileError, match="it is a folder"):
        la.Mechanism.load(tmp_path / "folder.yaml")


def test_every_truncation_is_an_error_or_a_smaller_mechanism() -> None:
    for notation in ("yaml", "json"):
        text = text_of(build("four_bars"), notation)  # type: ignore[arg-type]
        for end in range(0, len(text), 37):
            with contextlib.suppress(LeastActionError):
                from_text(text[:end], notation)  # type: ignore[arg-type]


JUNK = [
    None, True, -1, 0, 1e308, float("nan"), float("inf"), "", " ", "x", "10 kg", [], {}, [1], [1, 2, 3], {"a": 1},
    {"type": "tx"}, -1e-320, 10**400, [[1]], "world",
]  # fmt: skip


def places(data: Any) -> list[tuple[Any, Any]]:
    """Return every place in plain data, as what holds it and its key."""
    keys: Any = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [place for key, value in keys for place in ((data, key), *places(value))]


@pytest.mark.filterwarnings("ignore")
def test_whatever_is_broken_is_an_error_with_a_name_or_a_mechanism() -> None:
    rng = random.Random(2)
    sound = [plan_data(build(name)._plan) for name in ("cart_pendulum", "puppet_arm", "bricard", "scissor_lift")]
    refused = 0
    for _ in range(300):
        data = copy.deepcopy(rng.choice(sound))
        holder, key = rng.choice(places(data))
        if rng.random() < 0.2:
            del holder[key]
        else:
            holder[key] = rng.choice(JUNK)
        try:
            mechanism = from_text(document_text(data, "yaml"))
        except LeastActionError:
            refused += 1
        else:
            assert from_text(text_of(mechanism)) == mechanism
    assert 150 < refused < 300


def test_a_mechanism_that_cannot_be_is_a_description_error() -> None:
    with pytest.raises(DescriptionError, match="massless dynamic variable 'theta'"):
        from_text(GOOD.replace(", mass: 1.0}", "}"))


def test_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism, path = build("cart_pendulum"), tmp_path / "m.yaml"
    mechanism.save(path)
    before = path.read_bytes()

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match=r"cannot write .*m\.yaml: No space left"):
        build("puppet_arm").save(path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    for wrong in (tmp_path / "none" / "m.yaml", tmp_path):
        with pytest.raises((OutputError, ModelFileError)):
            mechanism.save(wrong)
    with pytest.raises(ModelFileError, match=r"ending '\.xml'"):
        mechanism.save(tmp_path / "m.xml")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot write"):
        build("cart_pendulum").save(tmp_path / "m.yaml")
    tmp_path.chmod(0o700)


def test_the_names_of_yaml_are_names(tmp_path: Path) -> None:
    names = [
        "yes",
        "no",
        "on",
        "null",
        "~",
        "1",
        "1e3",
        "0x1",
        "true",
        "a: b",
        "# c",
        " d ",
        "é",
        "'",
        "-",
        "1_0",
        "12:30",
    ]
    tree: Any = la.world()
    for name in names:
        tree = tree.rz(name, mass=1.0, inertia=(1, 1, 1), name=f"{name}!")
    mechanism = la.Mechanism(tree)
    again = from_text(text_of(mechanism))
    assert again == mechanism
    assert again.variables == tuple(names)
    assert json.loads(text_of(mechanism, "json"))["leastaction"] == "mechanism 1"
