"""Compiled kernels are kept in folders of their own, trusted, marked, and never stale."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from flight_sw.runtime import jit, kernel_cache
from flight_sw.runtime.kernel_cache import FOLDERS_KEPT, MARK, KernelFolder

SAVERS, KEYS = 4, 40

SAVE = """
import sys
from pathlib import Path
from flight_sw.runtime.kernel_cache import KernelFolder
folder, saver, keys = sys.argv[1:]
for i in range(int(keys)):
    KernelFolder(Path(folder)).save(f"{i}.kernel", f"{i} ".encode() * 1000)
"""

LIMIT = """
LIMIT_RAD = {limit}
"""
KERNEL = """
from {package}.constants import LIMIT_RAD
from {package}.jit import kernel

@kernel
def limit(x):
    return min(x, LIMIT_RAD)
"""
ASK = """
import sys
sys.path.insert(0, sys.argv[1])
sys.dont_write_bytecode = True
from flight_sw.runtime import kernel_cache
told = []
from laws.limit import limit
with kernel_cache.on_compiling(lambda: told.append(1)):
    print(limit(10.0), len(told))
"""


def asked(folder: Path, cache: Path | str, **more: str) -> tuple[str, list[str]]:
    """What a kernel of a package in a folder says in a process of its own, and its stderr."""
    done = subprocess.run(
        [sys.executable, "-c", ASK, str(folder)], capture_output=True, text=True, check=True,
        cwd=jit.FLIGHT_ROOT.parent, timeout=120,
        env={**os.environ, jit.CACHE_VARIABLE: str(cache), **more},
    )  # fmt: skip
    return done.stdout.strip(), done.stderr.splitlines()


@pytest.fixture
def laws(tmp_path: Path) -> Path:
    """A folder with a package that has a constant, and a kernel that takes it from there."""
    package = tmp_path / "sources" / "laws"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    decorator = "from pathlib import Path\nfrom flight_sw.runtime.jit import kernel_decorator\n"
    (package / "jit.py").write_text(
        f"{decorator}kernel = kernel_decorator(Path(__file__).parent)\n"
    )
    (package / "limit.py").write_text(KERNEL.format(package="laws"))
    with_limit(package.parent, 1.5)
    return package.parent


def with_limit(sources: Path, limit: float) -> None:
    """The package with another constant, which the kernel's own file does not show."""
    (sources / "laws" / "constants.py").write_text(LIMIT.format(limit=limit))


def marked(root: Path, name: str, used_s: float) -> Path:
    """A folder of kernels that was used last so many seconds after 1970."""
    folder = KernelFolder(root / name)
    folder.open()
    folder.save(f"{name}.kernel", b"code")
    os.utime(folder.path, (used_s, used_s))
    return folder.path


def test_processes_that_fill_one_folder_together_find_what_they_saved(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SAVE, str(tmp_path / "kernels")]
    savers = [
        subprocess.Popen([*command, str(saver), str(KEYS)], cwd=jit.FLIGHT_ROOT.parent)
        for saver in range(SAVERS)
    ]
    assert [process.wait(timeout=60) for process in savers] == [0] * SAVERS
    folder = KernelFolder(tmp_path / "kernels")
    assert [folder.load(f"{i}.kernel") for i in range(KEYS)] == [
        f"{i} ".encode() * 1000 for i in range(KEYS)
    ]
    assert not list(folder.path.glob(f"*{kernel_cache.UNFINISHED}"))


@pytest.mark.jit_only
def test_a_changed_constant_of_another_file_is_compiled_in(laws: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert asked(laws, cache) == ("1.5 1", [])
    assert asked(laws, cache) == ("1.5 0", [])
    with_limit(laws, 0.5)
    assert asked(laws, cache) == ("0.5 1", [])


@pytest.mark.jit_only
@pytest.mark.parametrize("place", ["below a file", "not writable"])
def test_a_cache_that_cannot_be_written_is_said_and_nothing_stale_flies(
    place: str, laws: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    shut = tmp_path / "shut"
    shut.mkdir(0o500)
    if place == "not writable" and os.access(shut, os.W_OK):
        pytest.skip("this user may write everywhere")
    cache = tmp_path / "file" / "cache" if place == "below a file" else shut
    for limit in (1.5, 0.5):
        with_limit(laws, limit)
        number, said = asked(laws, cache)
        assert number == f"{limit} 1"
        (line,) = said
        assert line.startswith(f"kernel cache {cache} cannot be written (")
        assert line.endswith("): kernels are compiled in memory")
    assert not list(laws.rglob("*.nbi")) + list(laws.rglob("*.nbc"))


@pytest.mark.jit_only
def test_another_process_locator_of_numba_changes_nothing(laws: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    locators = {"NUMBA_CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    for limit in (1.5, 0.5):
        with_limit(laws, limit)
        assert asked(laws, tmp_path / "file" / "cache", **locators)[0] == f"{limit} 1"
    assert not list(laws.rglob("*.nbi"))


@pytest.mark.jit_only
@pytest.mark.parametrize(("which", "mode"), [("root", 0o707), ("folder", 0o770)])
def test_a_folder_that_others_may_write_to_is_not_read(
    which: str, mode: int, laws: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    asked(laws, cache)
    (folder,) = kernel_cache.marked_folders(cache)
    writable = cache if which == "root" else folder
    writable.chmod(mode)
    number, (line,) = asked(laws, cache)
    assert number == "1.5 1"
    assert line == (
        f"kernel cache not used, kernels are compiled in memory: others may write to {writable}"
    )


@pytest.mark.skipif(os.geteuid() != 0, reason="only the superuser gives a folder away")
@pytest.mark.jit_only
def test_a_folder_of_another_user_is_not_read(laws: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    cache.mkdir(0o755)
    os.chown(cache, 4321, 4321)
    number, (line,) = asked(laws, cache)
    assert number == "1.5 1"
    assert line.endswith(f"{cache} belongs to another user")
    assert not list(cache.iterdir())


@pytest.mark.jit_only
def test_a_damaged_kernel_is_compiled_anew(laws: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    asked(laws, cache)
    (kept,) = cache.rglob("laws.limit.limit.*")
    whole = kept.read_bytes()
    folder = KernelFolder(kept.parent)
    for damaged in (b"", whole[:-1], whole[:100], b"x" + whole[1:], whole[:-9] + b"x" + whole[-8:]):
        kept.write_bytes(damaged)
        assert folder.load(kept.name) is None
    assert asked(laws, cache) == ("1.5 1", [])
    assert kept.stat().st_size == len(whole)


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o1777])
def test_any_right_of_others_to_write_is_seen(mode: int, tmp_path: Path) -> None:
    tmp_path.chmod(mode)
    assert kernel_cache.distrust(tmp_path) == f"others may write to {tmp_path}"


def test_the_folder_is_made_for_this_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        KernelFolder(tmp_path / "a" / "b" / "c").save("x.kernel", b"code")
    finally:
        os.umask(before)
    made = [tmp_path / "a", tmp_path / "a/b", tmp_path / "a/b/c"]
    assert [path.stat().st_mode & 0o777 for path in made] == [0o700] * 3
    assert kernel_cache.distrust(tmp_path / "a" / "b" / "c") == ""


def test_importing_the_kernels_makes_no_folder_and_deletes_none(tmp_path: Path) -> None:
    own = [tmp_path / f"own-{i}" for i in range(20)]
    for folder in own:
        folder.mkdir()
        (folder / "thesis.tex").touch()
    missing = tmp_path / "none"
    for cache in (tmp_path, missing):
        subprocess.run(
            [sys.executable, "-c", "import flight_sw.runtime.jit, sim_harness.jit"], check=True,
            env={**os.environ, jit.CACHE_VARIABLE: str(cache)}, cwd=jit.FLIGHT_ROOT.parent,
        )  # fmt: skip
    assert sorted(tmp_path.iterdir()) == sorted(own)
    assert all((folder / "thesis.tex").is_file() for folder in own)


def test_only_marked_folders_are_dropped_and_those_used_last_stay(tmp_path: Path) -> None:
    own = [tmp_path / f"{i:016x}" for i in range(20)]
    for folder in own:
        folder.mkdir()
        os.utime(folder, (1.0, 1.0))
    impostor = tmp_path / "impostor"
    impostor.mkdir()
    (impostor / MARK).write_text("something else")
    link = tmp_path / "link"
    ours = [marked(tmp_path, f"kernels-{i:02}", 1000.0 + i) for i in range(FOLDERS_KEPT + 5)]
    link.symlink_to(ours[0])
    KernelFolder(tmp_path / "newest").save("x.kernel", b"code")
    left = {path.name for path in tmp_path.iterdir()}
    assert {path.name for path in own} | {"impostor", "link", "newest"} <= left
    kept = sorted(name for name in left if name.startswith("kernels-"))
    assert kept == [path.name for path in ours[-(FOLDERS_KEPT - 1) :]]


def test_what_somebody_put_beside_kernels_is_not_deleted(tmp_path: Path) -> None:
    folder = marked(tmp_path / "cache", "old", 1.0)
    (folder / "notes.txt").write_text("mine")
    kernel_cache.remove_all(tmp_path / "cache")
    assert sorted(p.name for p in folder.iterdir()) == [MARK, "notes.txt"]
    (folder / "notes.txt").unlink()
    kernel_cache.remove_all(tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_cleaning_leaves_folders_without_the_mark(tmp_path: Path) -> None:
    ours, own = marked(tmp_path, "ours", 1.0), tmp_path / "own"
    own.mkdir()
    kernel_cache.remove_all(tmp_path)
    assert not ours.exists()
    assert own.is_dir()


def test_a_folder_of_the_same_name_that_is_not_ours_is_not_adopted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = KernelFolder(tmp_path / "0123456789abcdef")
    folder.path.mkdir()
    (folder.path / "thesis.tex").touch()
    folder.save("x.kernel", b"code")
    assert [path.name for path in folder.path.iterdir()] == ["thesis.tex"]
    assert "cannot be written" in capsys.readouterr().err


def test_a_folder_that_vanishes_is_made_again(tmp_path: Path) -> None:
    folder = KernelFolder(tmp_path / "kernels")
    folder.save("x.kernel", b"code")
    shutil.rmtree(folder.path)
    folder.save("y.kernel", b"code")
    assert folder.load("y.kernel") == b"code"
    assert kernel_cache.is_marked(folder.path)
