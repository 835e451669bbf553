"""The result file: everything that is needed to look at a run again, or to go on with it.

One NumPy ``.npz`` archive, readable without this package: ``numpy.load(path)`` gives the arrays
under the names of `RunRecord`, and ``leastaction_record`` is a JSON text with the names, settings,
versions and status. No pickled object is written or read.
"""

from __future__ import annotations

import json
import os
import platform
import zipfile
import zlib
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from leastaction._version import __version__
from leastaction.errors import ArgumentError, ResultFileError
from leastaction.io.results.record import RunRecord
from leastaction.numerics.files import atomic_write

FORMAT_VERSION: Final = 1
_HEADER: Final = "leastaction_record"
_HISTORY: Final = "history_"
_ARRAYS: Final = (
    "t",
    "q",
    "p",
    "v",
    "u",
    "lam",
    "x",
    "K",
    "K_projection",
    "x_wanted",
    "u_wanted",
    "q_wanted",
    "tension",
)
_OPTIONAL: Final = frozenset({"K_projection", "x_wanted", "u_wanted", "q_wanted", "tension"})


def current_versions() -> dict[str, str]:
    """Return the versions of Python, the platform and the packages that a result depends on."""
    return {
        "leastaction": __version__,
        "numpy": np.__version__,
        "scipy": metadata.version("scipy"),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def save_record(path: str | os.PathLike[str], record: RunRecord) -> Path:
    """Write a result file; an existing one is replaced in one step.

    Parameters
    ----------
    path
        The file, by custom ``trajectory.npz``. The name is used as given.
    record
        What to write.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; an older file of that name is untouched.
    ArgumentError
        The settings hold something that is no plain data.
    """
    header = {
        "format": "leastaction run",
        "format_version": FORMAT_VERSION,
        "mechanism": record.mechanism,
        "variables": list(record.variables),
        "n_dynamic": record.n_dynamic,
        "inputs": list(record.inputs),
        "constraints": list(record.constraints),
        "settings": dict(record.settings),
        "versions": dict(record.versions or current_versions()),
        "status": record.status,
        "message": record.message,
        "created": record.created or datetime.now(UTC).isoformat(timespec="seconds"),
    }
    try:
        text = json.dumps(header, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"the settings must be numbers, texts, lists and dictionaries to be saved: {error}"
        ) from error
    arrays: dict[str, npt.NDArray[Any]] = {_HEADER: np.array(text), "rho": record.rho}
    arrays |= {name: value for name in _ARRAYS if (value := getattr(record, name)) is not None}
    arrays |= {
        _HISTORY + name: _plain_array(name, value) for name, value in record.histories.items()
    }
    with atomic_write(path) as stream:
        # Not compressed: the gains are noise to a compressor, which saves a twentieth and takes
        # longer than the run.
        np.savez(stream, **arrays)  # type: ignore[arg-type]
    return Path(path)


def load_record(path: str | os.PathLike[str]) -> RunRecord:
    """Read a result file.

    Parameters
    ----------
    path
        A file written by `save_record`.

    Returns
    -------
    RunRecord
        The run, every array checked against the names.

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not a result file, or of a newer format.
    """
    source = Path(path)
    try:
        with source.open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile) or _HEADER not in archive:
                raise ResultFileError(
                    f"{source} is a NumPy file but not a leastaction result. Give the trajectory.npz of an earlier run"
                )
            # The header decides whether the rest can be understood, so it is judged before the rest
            # is read.
            header = _header(source, str(archive[_HEADER][()]))
            arrays = {name: archive[name] for name in archive.files if name != _HEADER}
    except ResultFileError:
        raise
    except OSError as error:
        raise ResultFileError(
            f"cannot read {source}: {error.strerror or error}. Give the trajectory.npz of a run"
        ) from error
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, NotImplementedError) as error:
        raise ResultFileError(
            f"{source} is damaged or cut short ({error}). Copy it again, or run the optimisation again"
        ) from error
    except ValueError as error:
        raise ResultFileError(
            f"{source} is no result file of leastaction ({error}). Give the trajectory.npz of an earlier run"
        ) from error
    missing = [name for name in _ARRAYS if name not in _OPTIONAL and name not in arrays]
    if missing:
        raise ResultFileError(
            f"{source} is incomplete: it lacks {', '.join(missing)}. Run the optimisation again"
        )
    try:
        return RunRecord(
            mechanism=header["mechanism"],
            variables=tuple(header["variables"]),
            n_dynamic=header["n_dynamic"],
            inputs=tuple(header["inputs"]),
            constraints=tuple(header["constraints"]),
            **{name: arrays.get(name) for name in _ARRAYS},  # type: ignore[arg-type]
            histories={
                name.removeprefix(_HISTORY): value
                for name, value in arrays.items()
                if name.startswith(_HISTORY)
            },
            settings=header["settings"],
            versions=header["versions"],
            status=header["status"],
            message=header["message"],
            created=header["created"],
        )
    except (KeyError, TypeError, IndexError, ArgumentError) as error:
        raise ResultFileError(
            f"{source} contradicts itself ({error}). Run the optimisation again"
        ) from error


def _header(source: Path, text: str) -> dict[str, Any]:
    """Parse the JSON header and refuse what this version cannot understand."""
    try:
        header = json.loads(text)
        version = int(header["format_version"])
    except (ValueError, KeyError, TypeError) as error:
        raise ResultFileError(
            f"{source} has an unreadable header ({error}). Run the optimisation again"
        ) from error
    if version > FORMAT_VERSION:
        maker = header.get("versions", {}).get("leastaction", "a newer version")
        raise ResultFileError(
            f"{source} has format {version}, this leastaction reads up to "
            f"{FORMAT_VERSION}. Upgrade leastaction (it was written by {maker})"
        )
    return dict(header)


def _plain_array(name: str, value: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return a history as an array of numbers or text; objects would need pickling: refused."""
    array = np.asarray(value)
    if array.dtype.hasobject:
        raise ArgumentError(
            f"history {name!r} must hold numbers or texts to be saved, it holds {array.dtype}"
        )
    return array
