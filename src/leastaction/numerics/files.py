"""Files that are whole or absent, and folders that are checked before the work starts."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from leastaction.errors import OutputError


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a binary file that appears under its name only when it is whole.

    The bytes go to a hidden file in the same folder, are flushed to the disk and then moved over
    ``path`` in one step, so that a reader sees the old file or the new one, never a part. If the
    block raises (Ctrl-C included), the hidden file is removed and ``path`` stays as it was.

    ``path``: the file to write; its folder must exist. Yields the open hidden file, seekable. Raises `OutputError`: the
    file system refused to open, write or move the file.
    """
    target = Path(path)
    if not target.name:
        raise OutputError(f"cannot write {str(path)!r}: it names no file")
    # The same folder, because a move between file systems is a copy and a copy can be cut short.
    temporary = target.with_name(f".{target.name}.{os.getpid()}.{secrets.token_hex(4)}.part")
    try:
        with temporary.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(target)
        _flush_folder(target.parent)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"cannot write {target}: {error.strerror or error}. "
            "Choose a folder that exists, can be written and has space"
        ) from error
    finally:
        # After the move there is nothing left to remove; before it, the part must not stay behind.
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write ``content`` to ``path``, whole or not at all.

    Returns the file written. Raises `OutputError`: the file could not be written; nothing was changed.
    """
    with atomic_write(path) as stream:
        stream.write(content)
    return Path(path)


def write_text(path: str | os.PathLike[str], content: str) -> Path:
    """Write ``content`` to ``path`` as UTF-8, whole or not at all (see `write_bytes`)."""
    return write_bytes(path, content.encode("utf-8"))


@contextlib.contextmanager
def output_folder(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Make a folder as `prepare_output_folder` does; what of it was new and is still empty afterwards goes again.

    Nothing that was wrong with a run's input leaves an empty folder behind. Raises `OutputError` as that does.
    """
    target = Path(folder)
    new = [each for each in (target, *target.parents) if not each.exists()]
    try:
        yield prepare_output_folder(target)
    finally:
        for each in new:
            with contextlib.suppress(OSError):
                each.rmdir()


def prepare_output_folder(folder: str | os.PathLike[str]) -> Path:
    """Make ``folder`` (and its parents) and prove by writing that files can be put there.

    Call it before a long run: a folder that cannot be written should cost a second, not the run.

    ``folder``: the folder for the results; it may exist. Returns the folder. Raises `OutputError`: the folder cannot be
    made, is a file, or cannot be written.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise OutputError(f"the output folder {target} is a file. Name a folder, or remove the file") from error
    except OSError as error:
        raise OutputError(
            f"cannot make the output folder {target}: {error.strerror or error}. Name a folder that you may write"
        ) from error
    probe = target / f".leastaction-{os.getpid()}-{secrets.token_hex(4)}.probe"
    try:
        probe.write_bytes(b"probe")
    except OSError as error:
        raise OutputError(
            f"cannot write into the output folder {target}: {error.strerror or error}. Name a folder that you may write"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            probe.unlink(missing_ok=True)
    return target


def remove_earlier(folder: Path, names: Iterable[str]) -> None:
    """Remove files that an earlier run left, which would lie beside a result that is not theirs.

    ``names``: of files of the folder; those that are not there are left out. Raises `OutputError`: a file cannot be
    removed.
    """
    for name in names:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot remove {folder / name}, which belongs to an earlier run: {error.strerror or error}"
            ) from error


def _flush_folder(folder: Path) -> None:
    """Flush the folder's own entry where the platform can, so that the move survives a power cut."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
