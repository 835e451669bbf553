"""Files that hold no robot, or a broken one: what the errors say."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import leastaction
from leastaction import Gravity, Mechanism, load, tz
from leastaction.errors import ArgumentError, LeastActionError, MissingExtraError, ModelFileError

BAD = {
    "an empty file": ("", "the file is empty"),
    "no XML": ("v 1 2 3\nf 1 2 3", "this is no XML, it begins with 'v 1 2 3'"),
    "broken XML": ("<robot>\n<link name='a'>\n</robot>", r"line 3, column \d+: the XML is broken .*at '</robot>'"),
    "a xacro": ('<robot xmlns:xacro="http://x/xacro"><xacro:arg name="a"/><link name="b"/></robot>', "run `xacro"),
    "an SRDF": ('<robot name="r"><group name="arm"/></robot>', "it is an SRDF"),
    "a robot of no links": ('<robot name="r"/>', "it has no <link>"),
    "an SDF": ("<sdf/>", "it is an SDF; convert it"),
    "a fragment": ("<mujocoinclude/>", "a fragment that an MJCF includes"),
    "something else": ("<html/>", "an XML file of <html>; expected <robot>"),
    "links of one name": ('<robot><link name="a"/><link name="a"/></robot>', "two links are called 'a'"),
    "a link without a name": ("<robot><link/></robot>", "a <link>: a name is missing"),
    "a joint to nowhere": (
        '<robot><link name="arm"/><joint name="j" type="fixed"><parent link="arm"/><child link="arn"/></joint></robot>',
        "joint 'j': its child is an unknown link 'arn'; did you mean 'arm'?",
    ),
    "a joint without a parent": (
        '<robot><link name="a"/><joint name="j" type="fixed"><child link="a"/></joint></robot>',
        "joint 'j': its <parent link=...> is missing",
    ),
    "a circle": (
        '<robot><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
        "the links a, b hang on each other in a circle",
    ),
    "two joints before a link": (
        '<robot><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint></robot>',
        "'b' is the child of two joints, 'j' and 'k'",
    ),
    "another type of joint": (
        '<robot><link name="a"/><link name="b"/>'
        '<joint name="j" type="hinge"><parent link="a"/><child link="b"/></joint></robot>',
        "its type is 'hinge', expected one of revolute",
    ),
    "no number": (
        '<robot><link name="a"><inertial><mass value="one"/></inertial></link></robot>',
        "link 'a': mass: value='one', expected a number",
    ),
    "two numbers for three": (
        '<robot><link name="a"><inertial><origin xyz="1 2"/><mass value="1"/></inertial></link></robot>',
        "xyz='1 2', expected 3 numbers",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_named_errors(case: str, tmp_path: Path) -> None:
    text, message = BAD[case]
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    with pytest.raises(ModelFileError, match=message) as error:
        leastaction.load(file)
    assert str(file) in str(error.value)
    if case == "broken XML":
        assert error.value.line == 3


def test_comments_may_hold_what_xml_does_not_allow_there(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text('<?xml version="1.0"?>\n<!-- a -- b --->\n<robot name="r"><link name="a"/><!-- \n -- --></robot>')
    assert leastaction.load(file).mechanism.frames == ("world", "a")


def test_files_that_are_not_there(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    with pytest.raises(ModelFileError, match=r"there is no such file; beside it there is robot.xml"):
        leastaction.load(tmp_path / "robot.urdf")
    with pytest.raises(ModelFileError, match="this is a folder"):
        leastaction.load(tmp_path)


def test_mjcf_that_mujoco_does_not_read(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file = tmp_path / "model.xml"
    file.write_text('<mujoco>\n<worldbody>\n<body>\n<geom tpye="box"/></body></worldbody></mujoco>')
    with pytest.raises(ModelFileError, match=r"line 4: .*tpye") as error:
        leastaction.load(file)
    assert error.value.line == 4
    file.write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(ModelFileError, match="no <body> in it"):
        leastaction.load(file)


def test_mjcf_without_mujoco_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    file = tmp_path / "model.xml"
    file.write_text("<mujoco><worldbody><body/></worldbody></mujoco>")
    with pytest.raises(MissingExtraError, match=r"pip install 'leastaction\[models\]'"):
        leastaction.load(file)


def test_arguments_that_cannot_be(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text('<robot><link name="a"/></robot>')
    for options in ({"inertia": "lenient"}, {"floating": 1}, {"fixed": "j"}, {"motors": ["j"]}, {"motors": "j"}):
        with pytest.raises((ArgumentError, LeastActionError)):
            leastaction.load(file, **options)  # type: ignore[arg-type]


def test_options_are_not_for_files_of_ours(tmp_path: Path) -> None:
    file = Mechanism([tz("z", mass=1.0)], [Gravity()]).save(tmp_path / "fall.yaml")
    assert load(file).mechanism.variables == ("z",)
    with pytest.raises(ArgumentError, match=r"got floating for fall.yaml"):
        load(file, floating=True)
