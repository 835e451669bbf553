"""The text in a file of a dataset: all that is no array, as JSON, and what has to fit in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from leastaction.errors import ArgumentError, ResultFileError
from leastaction.numerics.dataset.archive import Archive
from leastaction.numerics.dataset.dataset import Dataset
from leastaction.numerics.dataset.provenance import Provenance

FORMAT_VERSION: Final = 2
"""Of the text in a file; those of before datasets lack the names and units in it, and nothing else."""

_AGAIN: Final = "Copy it again, or run the optimisation again"


class FileFormat(msgspec.Struct):
    """As much of the text in a file as says whether the rest can be understood."""

    format: Literal["leastaction run"]
    format_version: Annotated[int, msgspec.Meta(ge=1)]
    versions: dict[str, str]


class FileText(FileFormat):
    """The text in a file: all that is no array."""

    kind: str
    created: str
    content: dict[str, Any]
    dims: dict[str, tuple[str, ...]] = {}
    labels: dict[str, tuple[str, ...]] = {}
    units: dict[str, str | tuple[str, ...]] = {}
    system: dict[str, Any] = {}
    model: str | None = None


def text_of(dataset: Dataset) -> str:
    """Return what of a dataset is no array as JSON; raise an `ArgumentError` where it is no plain data."""
    text = {
        "format": "leastaction run",
        "format_version": FORMAT_VERSION,
        "versions": dict(dataset.provenance.versions),
        "kind": dataset.kind,
        "created": dataset.provenance.created,
        "content": dataset.content,
        "dims": dataset.dims,
        "labels": dataset.labels,
        "units": dataset.units,
        "system": dataset.system,
        "model": dataset.model,
    }
    try:
        return msgspec.json.encode(text).decode()
    except (TypeError, ValueError, RecursionError) as error:
        raise ArgumentError(
            f"{dataset.kind}: only arrays, numbers, texts, lists, mappings and dataclasses of these can be saved "
            f"({error})"
        ) from error


def parsed(source: Path, archive: Archive) -> Dataset:
    """Return a text and arrays as a dataset; raise a `ResultFileError` for what is none, or of another format."""
    try:
        found = msgspec.json.decode(archive.text, type=FileFormat)
        if found.format_version != FORMAT_VERSION:
            raise _unknown_format(source, found)
        text = msgspec.json.decode(archive.text, type=FileText)
    except ResultFileError:
        raise
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise ResultFileError(f"{source} is damaged or of another version: {error}. {_AGAIN}") from error
    return Dataset(
        kind=text.kind,
        t=archive.arrays.get("t", np.empty(0)),
        arrays=archive.arrays,
        dims=text.dims,
        labels=text.labels,
        units=text.units,
        content=text.content,
        system=text.system,
        model=text.model,
        provenance=Provenance(text.created, text.versions),
    )


def check_fit(source: Path, dataset: Dataset) -> None:
    """Raise a `ResultFileError` unless arrays have the dimensions, names and units that the dataset says."""
    for name, dims in dataset.dims.items():
        array = dataset.arrays.get(name)
        if array is None or array.ndim != len(dims):
            raise ResultFileError(
                f"{source} contradicts itself: {name} is no array of {len(dims)} dimensions. {_AGAIN}"
            )
        for size, dim in zip(array.shape, dims, strict=True):
            if dim in dataset.labels and len(dataset.labels[dim]) != size:
                raise ResultFileError(
                    f"{source} contradicts itself: {name} has {size} entries along {dim}, of which there are "
                    f"{len(dataset.labels[dim])} names. {_AGAIN}"
                )
        unit = dataset.units.get(name, "")
        if not isinstance(unit, str) and len(unit) != array.shape[-1]:
            raise ResultFileError(f"{source} contradicts itself: {name} has {len(unit)} units. {_AGAIN}")


def _unknown_format(source: Path, found: FileFormat) -> ResultFileError:
    maker = found.versions.get("leastaction", "another version")
    advice = (
        f"Upgrade leastaction (it was written by {maker})"
        if found.format_version > FORMAT_VERSION
        else f"Run the optimisation again (it was written by {maker}); numpy.load still reads its arrays"
    )
    return ResultFileError(
        f"{source} has format {found.format_version}, this leastaction reads {FORMAT_VERSION}. {advice}"
    )
