"""What a Companion app says over time; pure: no socket, no clock of its own. Facts: pupil-labs-realtime-api 1.9."""

import math
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sensor_bench.clock import DeviceClock
from sensor_bench.device import Counts
from sensor_bench.signals import nine

RTP_HZ = 90_000
PX_PER_DEG, MIDDLE_PX = 15.5, {"Neon": (800.0, 600.0), "Invisible": (544.0, 540.0)}
NTP_MINUS_UNIX_S = 2_208_988_800
REPORT_S = 1.0
BLINK_EVENT, KEEP_ALIVE = 4, 5
IMU_HZ, NOD_DEG, NOD_HZ = 110.0, 10.0, 0.5


@dataclass
class VirtualApp:
    """One phone with glasses; true time in s, of which start_ns is second 0.

    clock: the phone's UNIX time against true time, in ns. loss: share of gaze datagrams that never leave, while their
    numbers go on; `counts` are exact.
    """

    clock: DeviceClock
    start_ns: int = 0
    model: str = "Neon"
    gaze_hz: float = 200.0
    seed: int = 1
    loss: float = 0.0
    worn: bool = True
    eyelids: bool = False
    battery_percent: int = 77
    counts: Counts = field(default_factory=Counts)
    events: list[dict[str, Any]] = field(default_factory=list)
    """What others have sent to be kept."""

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)

    def unix_ns(self, time_s: float) -> int:
        """Return what the phone's clock shows at a true time."""
        return self.clock.read_ns(self.start_ns + round(time_s * 1e9))

    def echo(self, octets: bytes, time_s: float) -> bytes:
        """Return the answer of the time echo."""
        return octets + (self.unix_ns(time_s) // 1_000_000).to_bytes(8, "big")

    def status(self, host: str, rtsp_port: int, echo_port: int) -> list[dict[str, Any]]:
        """Return the components of `/api/status`."""
        phone = {
            "battery_level": self.battery_percent,
            "battery_state": "OK",
            "device_id": "d1",
            "device_name": "Phone",
        }
        phone |= {"ip": host, "memory": 10**10, "memory_state": "OK", "time_echo_port": echo_port}
        hardware = {"version": "2.0", "glasses_serial": "-1", "world_camera_serial": "-1", "module_serial": "841684"}
        kinds = ("gaze", "eye_events", "imu") if self.model == "Neon" else ("gaze",)
        sensors = [
            {"sensor": kind, "conn_type": way, "connected": True, "ip": host, "port": rtsp_port, "protocol": "rtsp"}
            | {"params": f"camera={kind}"}
            for kind in kinds
            for way in ("WEBSOCKET", "DIRECT")
        ]
        parts = [("Phone", phone), ("Hardware", hardware), *(("Sensor", each) for each in sensors)]
        return [{"model": model, "data": data} for model, data in parts]


class Player:
    """One RTSP session of one kind of sensor: interleaved RTP and RTCP from `begin_s` on."""

    def __init__(self, app: VirtualApp, kind: str, begin_s: float) -> None:
        self._app, self._kind = app, kind
        self._sequence, self._ticks0 = 65_500, 4_294_000_000  # so that both wrap soon
        self._done_s = self._reported_s = begin_s - REPORT_S
        self._done_s = begin_s
        self._zero_ns = app.unix_ns(begin_s)

    def send(self, time_s: float) -> bytes:
        """Return all that is sent up to that true time since the last call."""
        sent = b""
        if time_s - self._reported_s >= REPORT_S:
            self._reported_s = time_s
            sent += self._report(time_s)
        sent += {"gaze": self._gaze, "eye_events": self._blinks, "imu": self._nods}[self._kind](time_s)
        self._done_s = time_s
        return sent

    def _gaze(self, time_s: float) -> bytes:
        app, sent = self._app, b""
        for number in range(int(self._done_s * app.gaze_hz) + 1, int(time_s * app.gaze_hz) + 1):
            at_s = number / app.gaze_hz
            self._sequence += 1
            app.counts.samples_sent += 1
            if app.loss and app.random.random() < app.loss:
                app.counts.samples_lost += 1
                continue
            sent += self._packet(self._datagram(at_s), app.unix_ns(at_s))
        return sent

    def _datagram(self, at_s: float) -> bytes:
        app, times_s = self._app, np.array([at_s])
        middle, turned = MIDDLE_PX[app.model], nine.gaze_deg(times_s)[0] * PX_PER_DEG
        plain = struct.pack("!ffB", middle[0] + turned[0], middle[1] - turned[1], 255 if app.worn else 0)
        if app.model == "Invisible":
            return plain
        mm = 0.0 if nine.shut(times_s)[0] else float(nine.pupil_mm(times_s)[0])
        left = (mm + 0.05 if mm else 0.0, -31.0, 12.0, -30.0, 0.05, -0.1, 0.99)
        right = (mm - 0.05 if mm else 0.0, 31.0, 12.0, -30.0, -0.05, -0.1, 0.99)
        state = plain + struct.pack("!14f", *left, *right)
        lids = (0.5, -0.5, 9.0 if mm else 0.0, 0.4, -0.4, 8.5 if mm else 0.0)  # angles of upper and lower lid, aperture
        return state + struct.pack("!6f", *lids) if app.eyelids else state

    def _nods(self, time_s: float) -> bytes:
        """Return the samples of the IMU: the head nods about its x axis."""
        app, sent = self._app, b""
        for number in range(int(self._done_s * IMU_HZ) + 1, int(time_s * IMU_HZ) + 1):
            unix_ns = app.unix_ns(number / IMU_HZ)
            self._sequence += 1
            sent += self._packet(imu_message(number / IMU_HZ, unix_ns), unix_ns)
        return sent

    def _blinks(self, time_s: float) -> bytes:
        """Return a blink once it has ended."""
        sent = b""
        for at_s in nine.BLINKS_S:
            turn_s = time_s // nine.SECONDS * nine.SECONDS
            begin_s, end_s = turn_s + at_s - nine.BLINK_S / 2, turn_s + at_s + nine.BLINK_S / 2
            if self._done_s < end_s <= time_s:
                self._sequence += 1
                times = [self._app.unix_ns(each) for each in (begin_s, end_s)]
                sent += self._packet(struct.pack("!iqq", BLINK_EVENT, *times), times[1])
        return sent

    def _ticks(self, unix_ns: int) -> int:
        return (self._ticks0 + round((unix_ns - self._zero_ns) * RTP_HZ / 1e9)) % (1 << 32)

    def _packet(self, payload: bytes, unix_ns: int) -> bytes:
        head = struct.pack("!BBHII", 0x80, 0x60, self._sequence % (1 << 16), self._ticks(unix_ns), 0x1234ABCD)
        return _interleaved(0, head + payload)

    def _report(self, time_s: float) -> bytes:
        unix_ns = self._app.unix_ns(time_s)
        whole, rest = divmod(unix_ns, 10**9)
        ntp = (whole + NTP_MINUS_UNIX_S, (rest << 32) // 10**9)
        return _interleaved(1, struct.pack("!BBHIIIIII", 0x80, 200, 6, 0x1234ABCD, *ntp, self._ticks(unix_ns), 0, 0))


def imu_message(at_s: float, unix_ns: int) -> bytes:
    """Return the protobuf message of one sample: g, degrees per s, quaternion; numbers that are 0 are left out."""
    phase = 2 * math.pi * NOD_HZ * at_s
    angle = math.radians(NOD_DEG) * math.sin(phase)
    speed_dps = NOD_DEG * 2 * math.pi * NOD_HZ * math.cos(phase)
    parts = ((0.0, math.sin(angle), math.cos(angle)), (speed_dps, 0.0, 0.0), _quaternion(angle))
    message = b"\x08" + _varint(unix_ns)
    for number, values in enumerate(parts, 2):
        floats = [bytes([place << 3 | 5]) + struct.pack("<f", each) for place, each in enumerate(values, 1) if each]
        content = b"".join(floats)
        message += bytes([number << 3 | 2]) + _varint(len(content)) + content
    return message


def _quaternion(angle: float) -> tuple[float, float, float, float]:
    return (math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0)


def _varint(number: int) -> bytes:
    octets = [number >> shift & 0x7F | 0x80 for shift in range(0, max(1, number.bit_length()), 7)]
    return bytes([*octets[:-1], octets[-1] & 0x7F])


def _interleaved(channel: int, octets: bytes) -> bytes:
    return b"$" + bytes([channel]) + struct.pack("!H", len(octets)) + octets
