"""What is in a file, in words for the terminal and as JSON: a model, a run, a result, a run of the marionette."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from leastaction.apps.cli.mechanism.source import MODEL_FILES, left_out, model_of
from leastaction.errors import LeastActionError
from leastaction.io.mechanisms import Model


def text_of(file: str) -> RenderableType:
    """Return what is in a file as something that a terminal shows."""
    found = _read(file)
    if isinstance(found, Model):
        return Text(f"{found.mechanism}\n{found}")
    if found is None:
        from leastaction.apps.cli.report import describe

        return describe(Path(file))
    return Text(str(found))


def facts_of(file: str) -> str:
    """Return what is in a file as JSON."""
    found = _read(file)
    facts: dict[str, Any]
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
    elif found is None:
        from leastaction.apps.cli.summary import run_summary
        from leastaction.apps.marionette.tracking import load_run

        facts = run_summary(load_run(Path(file)), None)
    else:
        facts = {"status": getattr(getattr(found, "status", None), "name", ""), "text": str(found)}
    return json.dumps(facts, default=str)


def _read(file: str) -> Any:
    """Return the model, run or result of a file; None for a run of the marionette, which has a form of its own."""
    if not Path(file).suffix or Path(file).suffix.lower() in MODEL_FILES:
        return model_of(file)
    from leastaction.io import open as open_file

    try:
        return open_file(file)
    except LeastActionError:
        if Path(file).suffix.lower() == ".npz":
            return None
        raise
