"""What is in a file, in words for the terminal and as JSON: a model, a capture, a run, a result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from leastaction.apps.cli.applications import Application, applications
from leastaction.apps.cli.mechanism.conversion import MARKER_FILES
from leastaction.apps.cli.mechanism.source import MODEL_FILES, left_out, model_of
from leastaction.io.mechanisms import Model


def text_of(file: str) -> RenderableType:
    """Return what is in a file as something that a terminal shows."""
    application = _application_of(file)
    if application is not None:
        return application.text_of(Path(file))
    found = _read(file)
    return Text(f"{found.mechanism}\n{found}" if isinstance(found, Model) else str(found))


def facts_of(file: str) -> str:
    """Return what is in a file as JSON."""
    facts: dict[str, Any]
    application = _application_of(file)
    if application is not None:
        return json.dumps(application.facts_of(Path(file)), default=str)
    found = _read(file)
    if isinstance(found, Model):
        m = found.mechanism
        facts = {
            "name": found.name,
            "variables": m.units and {name: m.units[name] for name in m.variables},
            "inputs": {name: m.units[name] for name in m.inputs},
            "constraints": list(m.constraints),
            "frames": list(m.frames),
            "mass": m.mass,
            "keyframes": list(found.keyframes),
            "limits": [str(limit) for limit in found.limits],
            "left_out": left_out(found),
        }
    else:
        facts = {"status": getattr(getattr(found, "status", None), "name", ""), "text": str(found)}
    return json.dumps(facts, default=str)


def _read(file: str) -> Any:
    """Return the model, capture, run or result of a file."""
    if _is_model(file):
        return model_of(file)
    from leastaction.io import open as open_file
    from leastaction.io import read_capture, read_markers

    if Path(file).suffix.lower() in MARKER_FILES:
        return read_markers(file)
    return read_capture(file) if _is_capture(file) else open_file(file)


def _is_capture(file: str) -> bool:
    return Path(file).suffix.lower() in (".bvh", ".amc", *MARKER_FILES)


def _is_model(file: str) -> bool:
    return not Path(file).suffix or Path(file).suffix.lower() in MODEL_FILES


def _application_of(file: str) -> Application | None:
    """Return the application that wrote a file, if one did."""
    if _is_model(file) or _is_capture(file):
        return None
    from leastaction.numerics.dataset.files import read

    kind = read(file).kind
    return next((each for each in applications() if kind in each.RECORDS), None)
