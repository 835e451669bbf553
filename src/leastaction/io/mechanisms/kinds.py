"""What kind of file it is, told from its first element; everything that holds no robot is an error that says so."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

from leastaction.errors import ModelFileError, brief

_COMMENT = re.compile("<!--.*?-->", re.DOTALL)

OWN = (".yaml", ".yml", ".json")


def read_text(path: Path) -> str:
    """Return the text of a file; raise `ModelFileError` if there is none."""
    if path.is_dir():
        raise ModelFileError(f"{path}: this is a folder; give the URDF, MJCF or YAML file in it")
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except FileNotFoundError:
        near = sorted(p.name for p in path.parent.glob(f"{path.stem}.*")) if path.parent.is_dir() else []
        hint = f"; beside it there is {', '.join(near)}" if near else "; check the path"
        raise ModelFileError(f"{path}: there is no such file{hint}") from None
    except OSError as error:
        raise ModelFileError(f"{path}: it cannot be read: {error.strerror}") from None
    if not text.strip():
        raise ModelFileError(f"{path}: the file is empty; expected a URDF, an MJCF or a file of Mechanism.save")
    return text


def parse(text: str, path: Path) -> ET.Element:
    """Return the outermost element of an XML text; raise `ModelFileError` with the line where it is broken.

    Comments may hold what XML does not allow in them, two hyphens, as the readers of robots do not mind that.
    """
    try:
        return ET.fromstring(_COMMENT.sub(lambda found: "\n" * found.group().count("\n"), text))
    except ET.ParseError as error:
        line, column = error.position
        if not text.lstrip().startswith("<"):
            start = brief(text.strip().splitlines()[0])
            raise ModelFileError(
                f"{path}: this is no XML, it begins with {start!r}; expected a URDF or an MJCF", line=1
            ) from None
        shown = brief(text.splitlines()[line - 1].strip()) if line <= len(text.splitlines()) else "the end of the file"
        raise ModelFileError(
            f"{path}, line {line}, column {column + 1}: the XML is broken ({error}), at {shown!r}", line=line
        ) from None


def is_mjcf(text: str) -> bool:
    """Return whether the outermost element is that of an MJCF, whose own reader says what is wrong in it."""
    found = re.search(r"<([A-Za-z_][\w:.-]*)", _COMMENT.sub("", text))
    return found is not None and found.group(1) == "mujoco"


def require_urdf(root: ET.Element, path: Path) -> None:
    """Raise a `ModelFileError` that says what an XML file is, if it is no URDF."""
    if root.tag == "robot":
        macro = [e.tag for e in root.iter() if str(e.tag).startswith("{") and "xacro" in str(e.tag)]
        if macro or path.suffix == ".xacro":
            raise ModelFileError(
                f"{path}: this is a xacro file, from which a URDF is made; run `xacro {path.name} > robot.urdf` and "
                "load that"
            )
        if root.find("link") is None:
            semantic = [tag for tag in ("group", "disable_collisions", "end_effector") if root.find(tag) is not None]
            what = "it is an SRDF, which says things about a URDF" if semantic else "it has no <link>"
            raise ModelFileError(f"{path}: the file holds no robot: {what}; load the URDF")
        return
    known = {
        "mujocoinclude": "a fragment that an MJCF includes; load the file that includes it",
        "sdf": "an SDF; convert it to a URDF or an MJCF",
        "package": "the manifest of a ROS package; load a URDF in it",
    }
    what = known.get(root.tag, f"an XML file of <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)")
    raise ModelFileError(f"{path}: the file holds no robot: it is {what}")
