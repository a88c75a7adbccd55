"""Rerun's viewer as a process: opened for a person, or without a window for a picture."""

import importlib.util
import os
import queue
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar
from urllib.parse import urlsplit

from flight_sw.errors import AeroshellError
from flight_sw.runtime.streams import say
from tools.review.stage import TIMELINE, quiet_rerun

if TYPE_CHECKING:
    from sim_harness.flight.flight import FlightRun
    from tools.review.live import LiveView

WINDOW = (1760, 990)
START_S, LOAD_S, NOTICES_S = (
    30.0,
    60.0,
    9.0,
)  # longest waits; how long a notice stays in the picture
LOOK_S, ANSWER_S = 0.25, 3.0
CALL_S = 30.0  # of one call to a viewer
SCHEMES = ("rerun", "rerun+http", "rerun+https")
ENVIRONMENT = {"RERUN_APP_ONLY": "true", "RUST_LOG": "warn"}  # its last word is what we tell
HERE = "127.0.0.1"  # Rerun's own default lets any machine send to the viewer
T = TypeVar("T")
LOST = (ConnectionError, RuntimeError)
"""What a client raises whose viewer is gone, or does not answer."""


class ViewerError(AeroshellError):
    """The viewer does not run here."""


class LateError(ViewerError):
    """The viewer runs, and did not answer in time."""


def retry_if_late(attempt: Callable[[], T]) -> T:
    """A viewer that was late has a second try, from its start: the machine may have been busy."""
    try:
        return attempt()
    except LateError as error:
        say(f"{error}; trying once more")
        return attempt()


def answered(call: Callable[[], T], within_s: float | None = None) -> T:
    """What a call to the viewer returns; a viewer that takes it and says nothing is given up.

    Rerun's own client waits for such a one without limit.
    """
    limit_s = CALL_S if within_s is None else within_s
    done: queue.SimpleQueue[tuple[Any, BaseException | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            done.put((call(), None))
        except BaseException as error:
            done.put((None, error))

    threading.Thread(target=run, daemon=True).start()
    try:
        value, error = done.get(timeout=limit_s)
    except queue.Empty:
        raise LateError(f"the Rerun viewer did not answer within {limit_s:z.2g} s") from None
    if isinstance(error, TimeoutError):
        raise LateError(f"the Rerun viewer did not answer ({error})") from error
    if error is not None:
        raise error
    return value


def executable() -> str:
    """The viewer's own program: the `rerun` on the path is a script that starts it as its child."""
    package = importlib.util.find_spec("rerun_cli")
    for folder in (package.submodule_search_locations or []) if package else []:
        if (program := Path(folder) / "rerun").is_file():
            return str(program)
    raise ViewerError("the Rerun viewer is not installed, `pip install rerun-sdk` brings it")


def free_port() -> int:
    """A port that nothing listens on."""
    with socket.socket() as probe:
        probe.bind((HERE, 0))
        return int(probe.getsockname()[1])


def needs_display() -> bool:
    """Whether a window cannot be opened here."""
    names = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    return sys.platform == "linux" and not any(os.environ.get(name) for name in names)


def start(arguments: list[str], log: Any) -> "subprocess.Popen[bytes]":
    """The viewer with these arguments, its messages going to `log`."""
    return subprocess.Popen(
        [executable(), "--bind", HERE, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        env={**os.environ, **ENVIRONMENT},
        start_new_session=True,
    )


def open_live() -> "tuple[str, subprocess.Popen[bytes]]":
    """A viewer that waits for a flight: its address and its process."""
    if needs_display():
        raise ViewerError(
            "--live: no display to open a window on; --viewer URL shows the flight elsewhere"
        )
    return retry_if_late(_open_live)


def _open_live() -> "tuple[str, subprocess.Popen[bytes]]":
    port = free_port()
    log = tempfile.TemporaryFile()
    process = start(["--port", str(port), "--hide-welcome-screen"], log)
    try:
        _connected(process, port, log)
    except BaseException:
        end(process)
        raise
    return address(port), process


class Live(NamedTuple):
    """Whether a flight is shown while it is flown, and in which viewer; none: a new one."""

    is_wanted: bool
    url: str | None

    def view_of(self, run: "FlightRun", manifest: dict[str, str]) -> "LiveView | None":
        """The listener that shows it, its viewer opened; nothing of Rerun is read without one."""
        if not self.is_wanted and self.url is None:
            return None
        from tools.review.live import LiveView

        url, process = (reachable(self.url), None) if self.url else open_live()
        return LiveView(run, manifest, url, _tell, process)


def _tell(sentence: str) -> None:
    say(sentence)


def reachable(url: str) -> str:
    """The address of a viewer that is open already, once it has answered."""
    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if parts.scheme not in SCHEMES or not host or not port or parts.path != "/proxy":
        raise ViewerError(f"--viewer {url}: allowed is an address like {address(9876)}")
    retry_if_late(lambda: _probe(url, (host, port)))
    return url


def _probe(url: str, where: tuple[str, int]) -> None:
    with socket.socket() as probe:
        probe.settimeout(ANSWER_S)
        try:
            probe.connect(where)
        except TimeoutError as error:
            raise LateError(f"--viewer {url}: no answer within {ANSWER_S:g} s") from error
        except (OSError, UnicodeError) as error:
            raise ViewerError(f"--viewer {url}: no viewer answers there ({error})") from error


def address(port: int) -> str:
    """Where a viewer of this machine listens."""
    return f"rerun+http://{HERE}:{port}/proxy"


def open_window(file: Path, at_s: float) -> None:
    """Open the viewer with a review, at a mission time, and leave it to its user."""
    if needs_display():
        raise ViewerError(
            "no display to open a window on; --save FILE.rrd keeps the review, "
            "--screenshot FILE.png draws it without one"
        )
    retry_if_late(lambda: _open_window(file, at_s))


def _open_window(file: Path, at_s: float) -> None:
    port = free_port()
    with tempfile.TemporaryFile() as log:
        process = start(["--port", str(port), "--hide-welcome-screen", str(file)], log)
        try:
            client = _connected(process, port, log)
            _await_loaded(client, process)
            answered(lambda: client.set_time(TIMELINE, duration=at_s, play_state="paused"))
        except LOST as error:
            if not _was_closed(process):
                raise ViewerError(f"the Rerun viewer ended too early ({error})") from error
        except BaseException:
            end(process)
            raise


def _was_closed(process: "subprocess.Popen[bytes]") -> bool:
    """Whether its user closed the window, rather than that it failed."""
    try:
        return process.wait(timeout=ANSWER_S) == 0
    except subprocess.TimeoutExpired:
        end(process)
        return False


def screenshot(file: Path, out: Path, at_s: float, window: tuple[int, int] = WINDOW) -> None:
    """Draw a review at one mission time, without a window."""
    retry_if_late(lambda: _screenshot(file, out, at_s, window))


def _screenshot(file: Path, out: Path, at_s: float, window: tuple[int, int]) -> None:
    port = free_port()
    size = f"{window[0]}x{window[1]}"
    options = ["--headless", "--window-size", size, "--port", str(port), "--hide-welcome-screen"]
    with tempfile.TemporaryFile() as log:
        began_s = time.monotonic()
        process = start([*options, str(file)], log)
        try:
            client = _connected(process, port, log)
            _await_loaded(client, process)
            answered(lambda: client.run_command("ui.toggle_top_panel"))
            answered(lambda: client.set_time(TIMELINE, duration=at_s, play_state="paused"))
            time.sleep(max(began_s + NOTICES_S - time.monotonic(), 1.0))
            answered(lambda: client.save_screenshot(str(out.resolve())))
            _await_file(out, process)
        except LOST as error:
            raise ViewerError(f"the Rerun viewer gave no picture: {error}") from error
        finally:
            end(process)


def end(process: "subprocess.Popen[bytes]") -> None:
    """End a viewer of ours."""
    process.terminate()
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _connected(process: "subprocess.Popen[bytes]", port: int, log: Any) -> Any:
    """A client of the viewer once it listens."""
    client_of = quiet_rerun().experimental.ViewerClient
    deadline_s = time.monotonic() + START_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            break
        with socket.socket() as probe:
            if probe.connect_ex((HERE, port)) == 0:
                return answered(lambda: client_of.connect(address(port)))
        time.sleep(LOOK_S)
    if process.poll() is None:
        raise LateError(f"the Rerun viewer does not listen after {START_S:g} s")
    log.seek(0)
    why = _last_line(log.read())
    raise ViewerError(
        f"the Rerun viewer did not start ({why}); it needs a display or, without a window, "
        "a Vulkan driver: Debian's mesa-vulkan-drivers has one that needs no graphics card"
    )


def _await_loaded(client: Any, process: "subprocess.Popen[bytes]") -> None:
    deadline_s = time.monotonic() + LOAD_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            raise ConnectionError("no answer")
        state = answered(client.get_state, max(deadline_s - time.monotonic(), LOOK_S))
        if state.recordings and not state.loading:
            return
        time.sleep(LOOK_S)
    raise LateError(f"the Rerun viewer did not load the review within {LOAD_S:g} s")


def _await_file(path: Path, process: "subprocess.Popen[bytes]") -> None:
    deadline_s = time.monotonic() + START_S
    size = -1
    while time.monotonic() < deadline_s and process.poll() is None:
        if path.exists() and path.stat().st_size == size > 0:
            return
        size = path.stat().st_size if path.exists() else -1
        time.sleep(LOOK_S)
    if process.poll() is None:
        raise LateError(f"the Rerun viewer wrote no picture within {START_S:g} s")
    raise ViewerError("the Rerun viewer wrote no picture")


def _last_line(content: bytes) -> str:
    lines = [line for line in content.decode(errors="replace").splitlines() if line.strip()]
    told = next((line for line in lines if "panicked" in line or "ERROR" in line), "")
    return (told or (lines[-1] if lines else "it said nothing")).strip()
