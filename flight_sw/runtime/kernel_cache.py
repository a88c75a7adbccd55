"""Keeps compiled kernels in files: in one folder a version of the sources, and nowhere else.

numba's own cache turns to `__pycache__` where its folder cannot be written, and looks there at the
one file that a kernel stands in: a kernel whose callee or constant has changed would fly. Here a
kernel that cannot be kept is compiled in memory, which is said. Loading a kernel runs what its file
says, so a folder that others may write to is not read. A file is whole or not there, named by all
that its kernel depends on: processes that fill one folder at the same time need no lock.
"""

import hashlib
import os
import pickle
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba.core import compiler, serialize
from numba.core.caching import _Cache

from flight_sw.runtime.streams import say

dumps: Callable[[object], bytes] = serialize.dumps
rebuilt: Callable[..., Any] = compiler.CompileResult._rebuild

MARK = "aeroshell-kernels"  # a file: only a folder that holds it is ever deleted
MARK_TEXT = b"Compiled kernels of Aeroshell, deleted when they have not been used for long.\n"
SUFFIX = ".kernel"
UNFINISHED = ".part"
FOLDERS_KEPT = 12  # versions of the sources whose kernels stay cached, most recently used first
NOTICE = "kernel cache"  # how its sentences begin
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
PRIVATE = 0o700
DIGEST_BYTES = 32

_awaited: list[Callable[[], None]] = []
_said: set[str] = set()


@contextmanager
def on_compiling(say: Callable[[], None]) -> Iterator[None]:
    """Call `say` before the first kernel that is really compiled in this block; not without one."""
    _awaited.append(say)
    try:
        yield
    finally:
        with suppress(ValueError):  # it has been called
            _awaited.remove(say)


def _compiling() -> None:
    while _awaited:
        _awaited.pop()()


def _say_once(text: str) -> None:
    """One line on stderr a process; what cannot be told decides on nothing."""
    if text not in _said:
        _said.add(text)
        say(text)


def distrust(folder: Path) -> str:
    """Why what a folder holds must not be run; empty where it may, or where there is none."""
    try:
        found = folder.stat()
    except OSError:
        return ""
    if found.st_uid != os.geteuid():
        return f"{folder} belongs to another user"
    if found.st_mode & OTHERS_WRITE:
        return f"others may write to {folder}"
    return ""


def is_marked(folder: Path) -> bool:
    """Whether a folder is one that this module has made."""
    try:
        if not stat.S_ISDIR(folder.lstat().st_mode):
            return False
        mark = folder / MARK
        return stat.S_ISREG(mark.lstat().st_mode) and mark.read_bytes() == MARK_TEXT
    except OSError:
        return False


def remove(folder: Path) -> None:
    """Delete a marked folder, its mark last; what somebody else put there stays, and so does it."""
    if not is_marked(folder):
        return
    with suppress(OSError):
        for path in folder.iterdir():
            if path.suffix in (SUFFIX, UNFINISHED):
                path.unlink(missing_ok=True)
        if {path.name for path in folder.iterdir()} == {MARK}:
            (folder / MARK).unlink()
            folder.rmdir()


def marked_folders(root: Path) -> list[Path]:
    """Folders of compiled kernels, those used last first."""
    found = []
    with suppress(OSError):
        for path in root.iterdir():
            if is_marked(path):
                found.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(found, reverse=True)]


def remove_all(root: Path) -> None:
    """Delete the compiled kernels of every version of the sources."""
    for folder in marked_folders(root):
        remove(folder)
    with suppress(OSError):  # holds something else, or is not there
        root.rmdir()


def make_private(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for this user alone."""
    for path in reversed([folder, *folder.parents]):
        with suppress(FileExistsError):
            path.mkdir(PRIVATE)


class KernelFolder:
    """The compiled kernels of one version of the sources."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_open = self._is_noted = False

    def trusted(self) -> bool:
        """Whether the folder may be read and written; says why not."""
        why = distrust(self.path.parent) or distrust(self.path)
        if why:
            _say_once(f"{NOTICE} not used, kernels are compiled in memory: {why}")
        return not why

    def open(self) -> None:
        """Make the folder with its mark and drop those not used for longest; raises OSError."""
        make_private(self.path.parent)
        with suppress(FileExistsError):
            self.path.mkdir(PRIVATE)
        if not is_marked(self.path):
            if any(self.path.iterdir()):
                raise FileExistsError(f"{self.path.name} is there and was made by something else")
            (self.path / MARK).write_bytes(MARK_TEXT)
        os.utime(self.path)
        for old in marked_folders(self.path.parent)[FOLDERS_KEPT:]:
            remove(old)

    def load(self, name: str) -> bytes | None:
        """What was kept under a name; None if nothing was, or if it is damaged."""
        if not self.trusted():
            return None
        try:
            raw = (self.path / name).read_bytes()
        except OSError:
            return None
        kept = raw[DIGEST_BYTES:]
        if hashlib.sha256(kept).digest() != raw[:DIGEST_BYTES]:
            return None
        if not self._is_noted:
            self._is_noted = True
            with suppress(OSError):
                os.utime(self.path)
        return kept

    def save(self, name: str, kept: bytes) -> None:
        """Keep something under a name, whole or not at all; says where that is not possible."""
        if not self.trusted():
            return
        try:
            if not self._is_open or not self.path.is_dir():
                self.open()
                self._is_open = True
            self._write(name, hashlib.sha256(kept).digest() + kept)
        except OSError as error:
            why = error.strerror or str(error)
            _say_once(
                f"{NOTICE} {self.path.parent} cannot be written ({why}): "
                "kernels are compiled in memory"
            )

    def _write(self, name: str, raw: bytes) -> None:
        handle, temporary = tempfile.mkstemp(UNFINISHED, dir=self.path)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(raw)
            os.replace(temporary, self.path / name)
        except OSError:
            with suppress(OSError):
                os.unlink(temporary)
            raise


@lru_cache
def _file_hash(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class KernelCache(_Cache):
    """numba's cache of one kernel, kept in a `KernelFolder`."""

    def __init__(self, function: Any, folder: KernelFolder) -> None:
        self._function = function
        self._folder = folder
        self._is_enabled = True

    @property
    def cache_path(self) -> str:
        """The folder, as numba asks for it."""
        return str(self._folder.path)

    def enable(self) -> None:
        """Load and save from here on."""
        self._is_enabled = True

    def disable(self) -> None:
        """Neither load nor save from here on."""
        self._is_enabled = False

    def flush(self) -> None:
        """Forget nothing: a name tells all that a kernel depends on."""

    def _name(self, signature: Any, codegen: Any) -> str:
        function = self._function
        code = function.__code__
        cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
        told = [repr(signature), repr(codegen.magic_tuple()), _file_hash(code.co_filename)]
        digest = hashlib.sha256("\n".join([*told, str(code.co_firstlineno)]).encode())
        digest.update(code.co_code + dumps(cells))
        return f"{function.__module__}.{code.co_name}.{digest.hexdigest()[:32]}{SUFFIX}"

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The kernel compiled for these types of arguments; None if it has to be compiled."""
        target_context.refresh()
        name = self._name(signature, target_context.codegen())
        kept = self._folder.load(name) if self._is_enabled else None
        if kept is not None:
            before, reduced = pickle.loads(kept)
            if before == signature:
                return rebuilt(target_context, *reduced)
        _compiling()
        return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep a compiled kernel, unless its code holds addresses of this process."""
        lifts = any(not loop.can_cache for loop in compiled.lifted)
        if self._is_enabled and not lifts and not compiled.library.has_dynamic_globals:
            name = self._name(signature, compiled.codegen)
            self._folder.save(name, dumps((signature, compiled._reduce())))
