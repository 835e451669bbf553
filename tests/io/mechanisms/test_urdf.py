"""URDFs written by hand: what their joints, limits, masses and names come to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import leastaction
from leastaction.errors import ArgumentError, ModelFileError
from leastaction.io.mechanisms import Model


def link(name: str, mass: float = 1.0, inertia: str = "", inside: str = "") -> str:
    moments = inertia or 'ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"'
    return (
        f'<link name="{name}"><inertial><origin xyz="0.1 0 0.2"/><mass value="{mass}"/><inertia {moments}/></inertial>'
        f"{inside}</link>"
    )


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/>{inside}</joint>'
    )


LIMIT = '<limit lower="-1" upper="2" effort="30" velocity="4"/>'


def loaded(folder: Path, inside: str, **options: object) -> Model:
    file = folder / "robot.urdf"
    file.write_text(f'<robot name="by hand">{inside}</robot>')
    return leastaction.load(file, **options)  # type: ignore[arg-type]


def bounds(model: Model) -> dict[object, tuple[object, object]]:
    return {
        (tuple(b.names.items()) if isinstance(b.names, dict) else b.names, b.of): (b.min, b.max)  # type: ignore[attr-defined]
        for b in model.limits
    }


def test_limits_of_place_speed_and_torque(tmp_path: Path) -> None:
    slide = joint("b", "one", "two", "prismatic", LIMIT)
    turn = joint("c", "two", "three", "continuous", '<limit effort="5" velocity="6"/>')
    parts = [link(name) for name in ("base", "one", "two", "three")]
    model = loaded(tmp_path, "".join([*parts, joint("a", "base", "one", inside=LIMIT), slide, turn]))
    assert model.mechanism.variables == ("a", "b", "c")
    assert model.mechanism.inputs == ("a.torque", "b.force", "c.torque")
    assert bounds(model) == {
        ("a.torque", "input"): (-30.0, 30.0),
        ("b.force", "input"): (-30.0, 30.0),
        ("c.torque", "input"): (-5.0, 5.0),
        ("a", "variable"): (-1.0, 2.0),
        ("b", "variable"): (-1.0, 2.0),
        ("a", "rate"): (-4.0, 4.0),
        ("b", "rate"): (-4.0, 4.0),
        ("c", "rate"): (-6.0, 6.0),
    }
    assert model.left_out == ()


def test_a_mimic_joint_moves_with_the_other(tmp_path: Path) -> None:
    first = joint("a", "base", "one", inside=LIMIT)
    second = joint(
        "b", "base", "two", inside=f'{LIMIT}<mimic joint="a" multiplier="-2" offset="0.3"/><dynamics damping="0.5"/>'
    )
    third = joint("c", "two", "three", inside='<mimic joint="b" multiplier="0.5"/>')
    model = loaded(tmp_path, "".join([*(link(n) for n in ("base", "one", "two", "three")), first, second, third]))
    assert model.mechanism.variables == ("a",)
    assert model.mechanism.inputs == ("a.torque",)
    assert model.mechanism.nc == 0
    plain = loaded(
        tmp_path,
        "".join(
            [
                *(link(n) for n in ("base", "one", "two", "three")),
                first,
                joint("b", "base", "two"),
                joint("c", "two", "three"),
            ]
        ),
    ).mechanism
    q = plain.configuration({"a": 0.2, "b": -2 * 0.2 + 0.3, "c": -0.2 + 0.15})
    E = np.array([[1.0], [-2.0], [-1.0]])
    np.testing.assert_allclose(model.mechanism.mass_matrix(np.array([0.2])), E.T @ plain.mass_matrix(q) @ E, atol=1e-14)
    assert bounds(model)[((("a", -2.0),), "variable")] == (-1.3, 1.7)
    assert model.mechanism.elements["damping"].coefficients == {"a": 2.0}  # type: ignore[attr-defined]
    fixed = loaded(tmp_path, (tmp_path / "robot.urdf").read_text()[22:-8], fixed=["a"])
    assert fixed.mechanism.variables == ("b", "c")


def test_what_follows_a_fixed_joint_stands_still(tmp_path: Path) -> None:
    text = "".join(
        [
            *(link(name) for name in ("base", "one", "two", "three")),
            joint("a", "base", "one", inside=LIMIT),
            joint("b", "base", "two", inside='<mimic joint="a" multiplier="-2" offset="0.3"/>'),
            joint("d", "two", "three", inside=LIMIT),
        ]
    )
    free, fixed = loaded(tmp_path, text).mechanism, loaded(tmp_path, text, fixed=["a"]).mechanism
    assert fixed.variables == ("d",)
    np.testing.assert_allclose(
        fixed.frame_pose(np.array([0.5]), "three"), free.frame_pose(free.configuration({"d": 0.5}), "three"), atol=1e-15
    )


def test_mimics_that_cannot_be(tmp_path: Path) -> None:
    parts = "".join(link(name) for name in ("base", "one", "two"))
    lost = parts + joint("a", "base", "one") + joint("b", "one", "two", inside='<mimic joint="elsewhere"/>')
    model = loaded(tmp_path, lost)
    assert model.mechanism.variables == ("a", "b")
    assert model.left_out[0].name == "mimic of the joint 'b'"
    circle = joint("a", "base", "one", inside='<mimic joint="b"/>') + joint(
        "b", "one", "two", inside='<mimic joint="a"/>'
    )
    with pytest.raises(ModelFileError, match="a -> b -> a follow each other in a circle"):
        loaded(tmp_path, parts + circle)


def test_a_free_base(tmp_path: Path) -> None:
    text = link("base") + link("arm") + joint("j", "base", "arm")
    model = loaded(tmp_path, text, floating=True)
    assert model.mechanism.variables == ("base.x", "base.y", "base.z", "base.wx", "base.wy", "base.wz", "j")
    assert ": 7 variables, " in str(model)  # of which eight numbers say where they are


def test_a_base_that_the_file_lets_free_is_not_let_free_twice(tmp_path: Path) -> None:
    base, more = link("base") + joint("free", "world", "base", "floating"), link("arm") + joint("j", "base", "arm")
    text = '<link name="world"/>' + base + more
    assert loaded(tmp_path, text).mechanism.nv == 7
    with pytest.raises(ArgumentError, match="'base' is free in space by the file"):
        loaded(tmp_path, text, floating=True)
    # A world with a mass, from which something is let free, is a body of its own.
    assert loaded(tmp_path, link("world") + base + more, floating=True).mechanism.nv == 13


def test_two_roots_are_named(tmp_path: Path) -> None:
    two = link("base") + link("arm") + link("other") + joint("j", "base", "arm")
    for more in ({}, {"floating": True}):
        with pytest.raises(ModelFileError, match="2 links are the child of no joint, 'base', 'other'; expected one"):
            loaded(tmp_path, two, **more)


def test_planar_and_floating_joints(tmp_path: Path) -> None:
    text = link("base") + link("sled") + link("bird")
    text += joint("p", "base", "sled", "planar") + joint("f", "base", "bird", "floating")
    mechanism = loaded(tmp_path, text).mechanism
    assert mechanism.variables == ("p.x", "p.y", "p.rz", "f.x", "f.y", "f.z", "f.wx", "f.wy", "f.wz")
    q = mechanism.configuration({"p.x": 1.0, "p.y": 2.0, "p.rz": 0.7})
    moved = np.linalg.inv(mechanism.frame_pose(mechanism.configuration(), "sled")) @ mechanism.frame_pose(q, "sled")
    assert moved[1, 3] == pytest.approx(0.0, abs=1e-15)  # along the normal
    assert np.linalg.norm(moved[:3, 3]) == pytest.approx(np.sqrt(5.0))
    assert moved[:3, 1] == pytest.approx([0.0, 1.0, 0.0])


def test_a_link_called_world(tmp_path: Path) -> None:
    text = '<link name="world"/>' + link("arm") + joint("j", "world", "arm")
    mechanism = loaded(tmp_path, text).mechanism
    assert mechanism.frames[:2] == ("ground", "world")
    assert mechanism.variables == ("j",)


def test_inertias_that_cannot_be(tmp_path: Path) -> None:
    rounding = 'ixx="-1e-20" iyy="1e-20" izz="0" ixy="0" ixz="0" iyz="0"'
    assert loaded(tmp_path, link("a") + link("b", inertia=rounding) + joint("j", "a", "b")).left_out == ()
    negative = 'ixx="-0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"'
    text = link("a") + link("b", inertia=negative) + joint("j", "a", "b")
    with pytest.raises(ModelFileError, match=r"link 'b': its inertia has the principal moments -0.1, 0.2, 0.25"):
        loaded(tmp_path, text)
    model = loaded(tmp_path, text, inertia="repair")
    assert [each.name for each in model.left_out] == ["inertia of 'b'"]
    (body,) = model.mechanism.tree.frames[model.mechanism.tree.index["b"]].frame.bodies
    # The second moments (0.275, -0.025, -0.075) without what is negative: a rod along x.
    np.testing.assert_allclose(body.inertia, np.diag([0.0, 0.275, 0.275]), atol=1e-15)
    with pytest.raises(ModelFileError, match="its mass is -1 kg"):
        loaded(tmp_path, link("a") + link("b", mass=-1.0) + joint("j", "a", "b"))
    flat = 'ixx="0.1" iyy="0.1" izz="0.25" ixy="0" ixz="0" iyz="0"'
    kept = loaded(tmp_path, link("a") + link("b", inertia=flat) + joint("j", "a", "b"))
    (body,) = kept.mechanism.tree.frames[kept.mechanism.tree.index["b"]].frame.bodies
    np.testing.assert_allclose(np.diag(body.inertia), [0.1, 0.1, 0.25])


def test_massless_links(tmp_path: Path) -> None:
    text = link("a") + '<link name="b"/>' + joint("j", "a", "b")
    with pytest.raises(ModelFileError, match=r"massless dynamic variable 'j'.*fixed=\[...\].*inertia='repair'"):
        loaded(tmp_path, text)
    model = loaded(tmp_path, text, inertia="repair")
    assert [each.name for each in model.left_out] == ["masslessness of 'b'"]
    assert loaded(tmp_path, text, fixed=["j"]).mechanism.nq == 0


MESH = (
    "solid m\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid m\n"
)


def test_shapes_and_where_meshes_are(tmp_path: Path) -> None:
    for folder in ("robot_description/meshes", "elsewhere/hand/meshes", "urdf"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "robot_description/meshes/a.stl").write_text(MESH)
    (tmp_path / "elsewhere/hand/meshes/b.stl").write_text(MESH)
    (tmp_path / "urdf/c.stl").write_text(MESH)

    def visual(geometry: str) -> str:
        return f'<visual><origin xyz="1 2 3"/><geometry>{geometry}</geometry><material name="red"/></visual>'

    visuals = "".join(
        visual(geometry)
        for geometry in (
            '<mesh filename="package://robot_description/meshes/a.stl" scale="1 2 3"/>',
            '<mesh filename="package://hand/meshes/b.stl"/>',
            '<mesh filename="c.stl"/>',
            '<mesh filename="package://nowhere/d.stl"/>',
            '<box size="1 2 3"/>',
            '<cylinder radius="0.1" length="0.5"/>',
            '<sphere radius="0.2"/>',
        )
    )
    text = '<material name="red"><color rgba="1 0 0 0.5"/></material>' + link("a", inside=visuals) + link("b")
    model = loaded(tmp_path / "urdf", text + joint("j", "a", "b"), packages=[tmp_path / "elsewhere"])
    assert [shape.kind for shape in model.shapes] == ["mesh"] * 3 + ["box", "cylinder", "sphere"]
    assert [shape.file.name for shape in model.shapes[:3] if shape.file] == ["a.stl", "b.stl", "c.stl"]
    np.testing.assert_array_equal(model.shapes[0].size, [1, 2, 3])
    np.testing.assert_array_equal(model.shapes[3].pose[:3, 3], [1, 2, 3])
    assert model.shapes[4].color == (1.0, 0.0, 0.0, 0.5)
    assert [each.name for each in model.left_out] == ["mesh 'package://nowhere/d.stl'"]


def test_what_a_mechanism_has_no_use_for(tmp_path: Path) -> None:
    more = '<gazebo/><gazebo/><transmission name="t"/>'
    safety = '<safety_controller k_velocity="1"/><calibration rising="0"/><dynamics damping="0.1" friction="0.2"/>'
    model = loaded(tmp_path, link("a") + link("b") + joint("j", "a", "b", inside=safety) + more)
    assert {each.name for each in model.left_out} == {
        "2 <gazebo>", "<transmission>", "safety_controller of the joint 'j'", "calibration of the joint 'j'",
    }  # fmt: skip
    assert {"damping", "friction.j"} <= set(model.mechanism.elements)


def test_bodies_take_the_place_of_what_the_file_says(tmp_path: Path) -> None:
    inside = '<link name="base"/><link name="hand"/>' + joint("turn", "base", "hand")
    with pytest.raises(ModelFileError, match="massless dynamic variable 'turn'"):
        loaded(tmp_path, inside)
    hand = leastaction.Body(2.0, com=(0.1, 0.0, 0.0), inertia=(0.01, 0.02, 0.02))
    m = loaded(tmp_path, inside, bodies={"hand": hand}).mechanism
    assert m.mass == 2.0
    np.testing.assert_allclose(m.mass_matrix([0.3]), [[0.02 + 2.0 * 0.1**2]], rtol=1e-14)
    given = loaded(tmp_path, link("base") + link("hand") + joint("turn", "base", "hand"), bodies={"hand": hand})
    np.testing.assert_allclose(given.mechanism.mass_matrix([0.3]), [[0.04]], rtol=1e-14)
    with pytest.raises(ArgumentError, match=r"bodies: .*'hnd'.*hand"):
        loaded(tmp_path, inside, bodies={"hnd": hand})
    with pytest.raises(ArgumentError, match=r"bodies: 'hand'.*Body"):
        loaded(tmp_path, inside, bodies={"hand": 2.0})


def test_a_range_that_ends_below_its_beginning_is_told(tmp_path: Path) -> None:
    turned_round = '<limit lower="1" upper="-1" effort="3" velocity="2"/>'
    model = loaded(tmp_path, link("a") + link("b") + joint("j", "a", "b", inside=turned_round))
    assert [str(each) for each in model.left_out] == ["range of the joint 'j': it ends at -1, below where it begins, 1"]
    assert ("j", "variable") not in bounds(model)
    unknown = '<limit lower="0" upper="0" effort="3" velocity="2"/>'
    assert not loaded(tmp_path, link("a") + link("b") + joint("j", "a", "b", inside=unknown)).left_out
