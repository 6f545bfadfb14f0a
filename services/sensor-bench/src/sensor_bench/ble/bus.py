"""A private D-Bus daemon as a child process: the bench's system bus, started again where it ends."""

import asyncio
import logging
import shutil
import socket
import tempfile
from pathlib import Path

from sense4hri.child_process import end_with_parent

log = logging.getLogger(__name__)

START_TIMEOUT_S = 10.0
STOP_TIMEOUT_S = 2.0
REVIVE_S = 1.0

CONFIG = """<!DOCTYPE busconfig PUBLIC "-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN"
 "http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd">
<busconfig>
  <type>session</type>
  <listen>unix:path={socket}</listen>
  <auth>EXTERNAL</auth>
  <policy context="default">
    <!-- other users too: in compose the drivers run under another uid than the bench -->
    <allow user="*"/>
    <allow own="*"/>
    <allow send_type="method_call"/>
    <allow send_type="signal"/>
    <allow send_requested_reply="true" send_type="method_return"/>
    <allow send_requested_reply="true" send_type="error"/>
    <allow receive_type="method_call"/>
    <allow receive_type="method_return"/>
    <allow receive_type="error"/>
    <allow receive_type="signal"/>
  </policy>
</busconfig>
"""


class BusError(RuntimeError):
    """The private bus could not be started; the message says why."""


def _is_listening(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
        return True


class PrivateBus:
    """`dbus-daemon` on a Unix socket of its own; clients use `DBUS_SYSTEM_BUS_ADDRESS=<address>`."""

    def __init__(self, socket_path: Path) -> None:
        self.socket_path = socket_path
        self._process: asyncio.subprocess.Process | None = None
        self._directory: tempfile.TemporaryDirectory[str] | None = None

    @property
    def address(self) -> str:
        return f"unix:path={self.socket_path}"

    async def start(self) -> None:
        """Start the daemon. Raises BusError."""
        try:
            await self._start()
        except OSError as err:
            raise BusError(f"no bus can be made at {self.socket_path}: {err.strerror or err}") from err

    async def revive(self) -> None:
        """Start another daemon where this one has ended, or ends within REVIVE_S; tries again for ever."""
        if self._process is not None:
            try:
                async with asyncio.timeout(REVIVE_S):
                    status = await self._process.wait()
            except TimeoutError:
                return
            log.error("the private bus ended with status %s; it is started again", status)
        while True:
            await asyncio.sleep(REVIVE_S)
            self._forget()
            try:
                return await self.start()
            except BusError as err:
                log.error("%s; trying again", err)

    async def _start(self) -> None:
        program = shutil.which("dbus-daemon")
        if program is None:
            raise BusError("dbus-daemon is missing: install the Debian package 'dbus' (or 'dbus-daemon')")
        if _is_listening(self.socket_path):
            raise BusError(f"another bus is already listening on {self.socket_path}")
        self.socket_path.parent.mkdir(parents=True, exist_ok=True)
        self.socket_path.unlink(missing_ok=True)
        self._directory = tempfile.TemporaryDirectory(prefix="sensor-bench-")
        config = Path(self._directory.name) / "bus.conf"
        config.write_text(CONFIG.format(socket=self.socket_path))
        with (Path(self._directory.name) / "log").open("wb") as errors:
            self._process = await asyncio.create_subprocess_exec(
                program,
                f"--config-file={config}",
                "--nofork",
                "--nopidfile",
                start_new_session=True,
                preexec_fn=end_with_parent,
                stderr=errors,
            )
        deadline = asyncio.get_running_loop().time() + START_TIMEOUT_S
        while not _is_listening(self.socket_path):
            if self._process.returncode is not None:
                said = (Path(self._directory.name) / "log").read_text(errors="replace").strip()
                raise BusError(f"dbus-daemon ended with status {self._process.returncode}: {said}")
            if asyncio.get_running_loop().time() > deadline:
                raise BusError(f"dbus-daemon does not listen on {self.socket_path} after {START_TIMEOUT_S:.0f} s")
            await asyncio.sleep(0.02)
        # a socket made under another umask must be usable by other users as well
        self.socket_path.chmod(0o777)
        log.info("private bus: DBUS_SYSTEM_BUS_ADDRESS=%s", self.address)

    async def stop(self) -> None:
        if self._process is None:
            return
        if self._process.returncode is None:
            self._process.terminate()
            try:
                async with asyncio.timeout(STOP_TIMEOUT_S):
                    await self._process.wait()
            except TimeoutError:
                self._process.kill()
                await self._process.wait()
        self._forget()

    def _forget(self) -> None:
        """Remove what a daemon that has ended leaves behind."""
        self.socket_path.unlink(missing_ok=True)
        if self._directory is not None:
            self._directory.cleanup()
