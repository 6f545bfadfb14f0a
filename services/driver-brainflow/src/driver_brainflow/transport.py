"""BrainFlow: its tables of boards, and a session with one of them. The only module that imports it."""

import contextlib
import ctypes
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from brainflow.board_shim import (
    BoardIds,
    BoardShim,
    BrainFlowError,
    BrainFlowExitCodes,
    BrainFlowInputParams,
    BrainFlowPresets,
)
from numpy.typing import NDArray
from sense4hri.errors import ConfigError, DeviceLost

SUFFIX = "_BOARD"
PLAYBACK, STREAMING, NONE = "PLAYBACK_FILE", "STREAMING", "NO"
SET_TIMER_SLACK = 29  # PR_SET_TIMERSLACK of prctl(2); 0 ns = the slack that the thread began with
SET_NAME, NAME = 15, "brainflow"  # PR_SET_NAME
SLACK_NS = 4_000_000  # by so much BrainFlow's threads may take a packet later
MUSES = ("MUSE_2", "MUSE_S", "MUSE_2016")  # one class of BrainFlow's
WAKE = signal.SIGURG  # means nothing to a process that does not ask for it
WAKE_EVERY_S = 0.05
BUFFER_S = 20.0  # of samples that BrainFlow keeps for a driver that does not come
PRESETS = {"default": BrainFlowPresets.DEFAULT_PRESET, "auxiliary": BrainFlowPresets.AUXILIARY_PRESET}
PRESETS["ancillary"] = BrainFlowPresets.ANCILLARY_PRESET
WORDS = {
    BrainFlowExitCodes.UNABLE_TO_OPEN_PORT_ERROR: "its serial port or Bluetooth adapter cannot be opened: is it "
    "plugged in, may this user open it, and does no other program hold it?",
    BrainFlowExitCodes.PORT_ALREADY_OPEN_ERROR: "its port is open already",
    BrainFlowExitCodes.BOARD_NOT_READY_ERROR: "it does not answer: is it switched on, near, charged, and free of other "
    "programs?",
    BrainFlowExitCodes.SYNC_TIMEOUT_ERROR: "no data came after the start",
    BrainFlowExitCodes.BOARD_WRITE_ERROR: "a command could not be sent to it",
    BrainFlowExitCodes.INITIAL_MSG_ERROR: "it answered the start with something else: is this the right board?",
    BrainFlowExitCodes.GENERAL_ERROR: "BrainFlow cannot reach it and says no more (`verbose: true` shows its log)",
}
CONFIGURATION = {
    BrainFlowExitCodes.INVALID_ARGUMENTS_ERROR: "BrainFlow misses or refuses its connection parameters (serial_port, "
    "mac_address, ip_address, ip_port, file, master_board)",
    BrainFlowExitCodes.UNSUPPORTED_BOARD_ERROR: "BrainFlow does not support this board on this system",
}


class Rows(NamedTuple):
    """What came of one preset: its name, BrainFlow's table, shape (rows, samples), when by the monotonic clock."""

    preset: str
    table: NDArray[np.float64]
    polled_s: float


def _load() -> None:
    """Load BrainFlow's library; below Python 3.12 it is looked for by setuptools, which calls that old."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        BoardShim.disable_board_logger()


def boards() -> dict[str, int]:
    """Return the number of each board by its name without `_BOARD`."""
    return {each.name.replace(SUFFIX, ""): each.value for each in BoardIds if each is not BoardIds.NO_BOARD}


def description(board: str) -> dict[str, dict[str, Any]]:
    """Return what BrainFlow's table says of a board: by preset, its rate, rows by kind, names.

    Raises ConfigError where BrainFlow's library cannot be loaded here: there is none for Linux on ARM.
    """
    number, names = boards()[board], {int(preset): name for name, preset in PRESETS.items()}
    try:
        _load()
        presets = sorted(int(preset) for preset in BoardShim.get_board_presets(number))
        return {names[preset]: BoardShim.get_board_descr(number, preset) for preset in presets}
    except OSError as err:
        raise ConfigError(f"board {board}: BrainFlow's library cannot be loaded on this machine: {err}") from err


@contextlib.contextmanager
def patient_threads() -> Iterator[None]:
    """Let threads that begin in here, which inherit this one's slack, sleep up to SLACK_NS longer than they ask.

    They inherit its name too, by which `turns` knows them.

    SimpleBLE asks D-Bus, sleeps 0.1 ms and asks again, for as long as there is a session.
    """
    name = _text(Path(f"/proc/self/task/{threading.get_native_id()}/comm")).strip()
    _set_of_thread(SET_TIMER_SLACK, ctypes.c_ulong(SLACK_NS))
    _set_of_thread(SET_NAME, NAME.encode())
    try:
        yield
    finally:
        _set_of_thread(SET_TIMER_SLACK, ctypes.c_ulong(0))
        _set_of_thread(SET_NAME, name.encode())


def _set_of_thread(what: int, value: ctypes.c_ulong | bytes) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(what, value)


def turns() -> int | None:
    """Return how often the threads that BrainFlow began while it connects, and the one that waits, have had a core.

    None where it has begun none, as for boards that are not on its own Bluetooth, which runs all the time.
    """
    threads = [task for task in Path("/proc/self/task").glob("*") if _text(task / "comm").strip() == NAME]
    if len(threads) < 2:
        return None
    lines = [line for task in threads for line in _text(task / "status").splitlines()]
    return sum(int(line.split()[1]) for line in lines if "ctxt_switches" in line)


def _text(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:  # the thread has ended
        return ""


@contextlib.contextmanager
def woken_sleeps() -> Iterator[None]:
    """Wake this thread whenever it sleeps in C in here; `WAKE` needs a handler, an ignored signal wakes nobody.

    BrainFlow lets a Muse fall silent for 2 s, twice, before it lets go of it.
    """
    sleeper, ended = threading.get_ident(), threading.Event()

    def wake() -> None:
        while not ended.wait(WAKE_EVERY_S):
            signal.pthread_kill(sleeper, WAKE)

    waker = threading.Thread(target=wake, name="waking", daemon=True)
    waker.start()
    try:
        yield
    finally:
        ended.set()
        waker.join()  # nobody is woken any more who may be gone


class _Shim(BoardShim):
    """BrainFlow's own lets go, when it is collected, of whichever session its board then has: it may be a later one."""

    def __del__(self) -> None:
        """Leave every session to `Session.close`."""


class Session:
    """One session of BrainFlow, from `open` to `close`; BrainFlow opens and closes within seconds, not at once.

    To be made in the main thread.
    """

    def __init__(self, board: str, given: Mapping[str, Any], commands: tuple[str, ...], verbose: bool) -> None:
        self._name, self._commands = board, commands
        inputs = BrainFlowInputParams()
        for name, value in given.items():
            setattr(inputs, name, value)
        (BoardShim.enable_board_logger if verbose else BoardShim.disable_board_logger)()
        self._shim = _Shim(boards()[board], inputs)
        signal.signal(WAKE, lambda number, frame: None)
        self._lock, self._closed, self._opened = threading.Lock(), False, False

    def open(self, presets: Iterable[str]) -> dict[str, float]:
        """Connect, send the commands, start; return each preset's rate in Hz, as the board has it now, which may differ
        from its table. Raises DeviceLost or ConfigError in words.
        """
        with self._lock:
            if self._closed:
                return {}
            try:
                with patient_threads():
                    self._shim.prepare_session()
                self._opened = True
                for command in self._commands:
                    self._send(command)
                rates_hz = {name: float(self._shim.get_board_sampling_rate(PRESETS[name])) for name in presets}
                self._shim.start_stream(round(BUFFER_S * max(rates_hz.values())))
                return rates_hz
            except BrainFlowError as err:
                self._release()
                raise self._in_words(err) from err

    def _send(self, command: str) -> None:
        """Send a command. Raises BrainFlowError, ConfigError where the board does not know it or takes none."""
        try:
            self._shim.config_board(command)
        except BrainFlowError as err:
            if err.exit_code not in CONFIGURATION:
                raise
            raise ConfigError(f"commands: {self._name} refuses {command!r}") from err

    def read(self, presets: tuple[str, ...], wait_s: float) -> list[Rows] | None:
        """Wait, then return what has come, by preset; None where nothing has. Raises DeviceLost."""
        time.sleep(wait_s)
        try:
            tables = [Rows(name, self._shim.get_board_data(preset=PRESETS[name]), time.monotonic()) for name in presets]
        except BrainFlowError as err:
            raise self._in_words(err) from err
        return [rows for rows in tables if rows.table.shape[1]] or None

    def close(self, lost: bool) -> None:
        """Stop the board and let go of it; one that is just being opened as soon as it is; a lost Muse at once."""
        self._closed = True
        at_once = lost and self._name in MUSES
        with self._lock, woken_sleeps() if at_once else contextlib.nullcontext():
            self._release()

    def _release(self) -> None:
        """Let go of what was opened here; BrainFlow knows a board by name and inputs: it may be a later session's."""
        opened, self._opened = self._opened, False
        with contextlib.suppress(BrainFlowError):  # a board that is gone cannot be stopped
            if opened and self._shim.is_prepared():
                self._shim.release_session()

    def _in_words(self, err: BrainFlowError) -> DeviceLost | ConfigError:
        code = BrainFlowExitCodes(err.exit_code)
        if code in CONFIGURATION:
            return ConfigError(f"board {self._name}: {CONFIGURATION[code]}")
        return DeviceLost(f"{self._name}: {WORDS.get(code, f'BrainFlow says {code.name}')}")
